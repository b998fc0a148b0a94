#include "core/io/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

#include "core/platform/error.h"

namespace fieldtrace {

namespace {

namespace fs = std::filesystem;

Error cannot_write(const std::string& path, const std::string& reason) {
  return Error({path}, "cannot be written: " + reason);
}

// The folder that holds `path`.
fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : fs::path("."); }

std::string resolve_target(const std::string& path) {
  if (path.empty()) throw Error("an empty file name cannot be written; name a file");
  std::error_code unknown;
  const fs::file_status status = fs::status(path, unknown);
  // Such as a final name that is too long. The temporary name is shorter and would hide that until the work is done.
  if (status.type() == fs::file_type::none) throw cannot_write(path, unknown.message());
  if (fs::is_directory(status) || path.back() == '/') throw cannot_write(path, "it is a folder; name a file");
  // Renaming onto a device would replace the device itself.
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    throw cannot_write(path, "it is not a regular file; name one");
  }
  return write_target(path);
}

// As many as Linux follows (path_resolution(7)).
constexpr int k_most_links = 40;

// Linux' NAME_MAX, where pathconf() reports no limit.
constexpr size_t k_longest_name = 255;

// At most `room` bytes of `name`, without a truncated UTF-8 sequence at the end.
std::string shortened(const std::string& name, size_t room) {
  if (name.size() <= room) return name;
  const auto continues = [&](size_t i) { return (static_cast<unsigned char>(name[i]) & 0xc0) == 0x80; };
  size_t length = room;
  while (length > 0 && continues(length)) --length;
  return name.substr(0, length);
}

// Unique among the processes of a machine by the process id and among threads by the counter. Processes of other
// machines, and killed ones, may have had the same: the next call then gives another. A name that leaves no room for
// these is shortened.
std::string temporary_name(const std::string& target) {
  static std::atomic<unsigned> counter{0};
  const fs::path path(target), folder = folder_of(path);
  const std::string ending = "." + std::to_string(getpid()) + "-" + std::to_string(counter++) + ".tmp";
  const long limit = pathconf(folder.c_str(), _PC_NAME_MAX);
  const size_t longest = limit > 0 ? size_t(limit) : k_longest_name;
  const size_t room = longest > ending.size() ? longest - ending.size() : 0;
  return (folder / (shortened(path.filename().string(), room) + ending)).string();
}

// Flushes the file or folder to disk: some file systems report a full disk only then. Sets errno on failure.
bool reaches_the_disk(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  const bool synced = fsync(file) == 0 || errno == EINVAL || errno == ENOSYS || errno == ENOTSUP;
  const int reason = errno;
  close(file);
  errno = reason;
  return synced;
}

// Writes over an existing file. False, with nothing changed, if it may not be opened; false, too, if that fails later.
bool copy_bytes(const std::string& from, const std::string& to) {
  const int in = open(from.c_str(), O_RDONLY | O_CLOEXEC), out = open(to.c_str(), O_WRONLY | O_CLOEXEC);
  bool copied = in >= 0 && out >= 0;
  std::vector<char> bytes(size_t(1) << 20);
  off_t size = 0;
  for (ssize_t read = 1; copied && read > 0;) {
    read = ::read(in, bytes.data(), bytes.size());
    copied = read >= 0;
    for (ssize_t done = 0; copied && done < read;) {
      const ssize_t written = ::write(out, bytes.data() + done, size_t(read - done));
      copied = written > 0;
      done += written;
    }
    size += std::max<ssize_t>(read, 0);
  }
  copied = copied && ftruncate(out, size) == 0 && fsync(out) == 0;
  if (in >= 0) close(in);
  if (out >= 0) copied = close(out) == 0 && copied;
  return copied;
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path), target_(resolve_target(path)) {
  std::string name;
  int file = -1;
  do {
    name = temporary_name(target_);
    file = open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
  } while (file < 0 && errno == EEXIST);
  if (file < 0) {
    const int reason = errno;
    const std::string advice = reason == ENOENT   ? " (make the folder first)"
                               : reason == EACCES ? " (choose a folder that you may write to)"
                                                  : "";
    throw cannot_write(path_, std::strerror(reason) + advice);
  }
  close(file);
  temporary_ = name;
}

AtomicFile::~AtomicFile() {
  if (!temporary_.empty()) unlink(temporary_.c_str());
}

void AtomicFile::commit() {
  if (!reaches_the_disk(temporary_)) throw cannot_write(path_, std::strerror(errno));
  struct stat replaced;
  if (stat(target_.c_str(), &replaced) == 0) chmod(temporary_.c_str(), replaced.st_mode & 07777);
  if (std::rename(temporary_.c_str(), target_.c_str()) == 0) {
    temporary_.clear();
  } else {
    write_over(errno);
  }
  // The new name, too. The file is whole either way, so a folder that may not be opened for reading is no failure.
  reaches_the_disk(folder_of(target_).string());
}

// `reason`: why the name cannot be replaced.
void AtomicFile::write_over(int reason) {
  const std::string written = std::exchange(temporary_, {});
  if (copy_bytes(written, target_)) {
    unlink(written.c_str());
    return;
  }
  // One name for all that is written there.
  std::string kept = target_ + ".whole";
  if (std::rename(written.c_str(), kept.c_str()) != 0) kept = written;
  throw cannot_write(path_, std::string(std::strerror(reason)) + "; the whole file is " + kept);
}

CheckedFile::CheckedFile(const std::string& path) : file_(open(path.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC)) {
  if (file_ < 0) error_ = errno;
}

CheckedFile::~CheckedFile() {
  if (file_ >= 0) ::close(file_);
}

bool CheckedFile::write_at(uint64_t offset, const void* data, size_t size) {
  const char* at = static_cast<const char*>(data);
  while (error_ == 0 && size > 0) {
    const ssize_t written = pwrite(file_, at, size, off_t(offset));
    if (written < 0) {
      if (errno != EINTR) error_ = errno;
      continue;
    }
    at += written;
    offset += uint64_t(written);
    size -= size_t(written);
    end_ = std::max(end_, offset);
  }
  return error_ == 0;
}

void CheckedFile::close() {
  if (file_ < 0) return;
  struct stat held;
  if (error_ == 0 && fstat(file_, &held) != 0) error_ = errno;
  if (error_ == 0 && uint64_t(held.st_size) != end_) error_ = EIO;
  if (::close(std::exchange(file_, -1)) != 0 && error_ == 0) error_ = errno;
}

std::string CheckedFile::reason() const { return std::strerror(error_); }

void write_text_file(const std::string& path, std::string_view text) {
  AtomicFile file(path);
  CheckedFile out(file.temporary_path());
  out.write_at(0, text.data(), text.size());
  out.close();
  if (out.failed()) throw cannot_write(path, out.reason());
  file.commit();
}

std::string write_target(const std::string& path) {
  // weakly_canonical() would leave a link whose target does not exist as it is.
  fs::path at(path);
  std::error_code failed;
  for (int links = 0; fs::is_symlink(fs::symlink_status(at, failed)); ++links) {
    const fs::path target = fs::read_symlink(at, failed);
    if (failed) throw cannot_write(path, failed.message());
    if (links == k_most_links) {
      throw cannot_write(path, "more than " + std::to_string(k_most_links) + " symbolic links follow one another");
    }
    at = at.parent_path() / target;
  }
  const fs::path whole =
      fs::absolute(at, failed);  // weakly_canonical() leaves a path unchanged if no part of it exists
  const fs::path resolved = fs::weakly_canonical(failed ? at : whole, failed);
  return failed ? at.string() : resolved.string();
}

std::string file_identity(const std::string& path) {
  struct stat file;
  if (stat(path.c_str(), &file) != 0) return write_target(path);
  return std::to_string(file.st_dev) + ":" + std::to_string(file.st_ino);  // unlike a path, without a leading slash
}

void require_writable(const std::string& path) {
  const AtomicFile probe(path);
  // Renaming asks for the folder's permission alone.
  if (access(path.c_str(), W_OK) != 0 && errno != ENOENT) throw cannot_write(path, std::strerror(errno));
}

}  // namespace fieldtrace
