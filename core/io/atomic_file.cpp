#include "core/io/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/platform/error.h"

namespace fieldtrace {

namespace {

Error cannot_write(const std::string& path, const std::string& reason) {
  return Error({path}, "cannot be written: " + reason);
}

std::string resolve_target(const std::string& path) {
  namespace fs = std::filesystem;
  if (path.empty()) throw Error("an empty file name cannot be written; name a file");
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  if (fs::is_directory(status) || path.back() == '/') throw cannot_write(path, "it is a folder; name a file");
  // Renaming onto a device would replace the device itself.
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    throw cannot_write(path, "it is not a regular file; name one");
  }
  std::error_code failed;
  const fs::path resolved = fs::weakly_canonical(path, failed);
  return failed ? path : resolved.string();
}

// Unique among processes by the process id, among threads by the counter; O_EXCL catches the rest.
std::string temporary_name(const std::string& target) {
  static std::atomic<unsigned> counter{0};
  return target + "." + std::to_string(getpid()) + "-" + std::to_string(counter++) + ".tmp";
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path), target_(resolve_target(path)) {
  const std::string name = temporary_name(target_);
  const int file = open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
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
  if (std::rename(temporary_.c_str(), target_.c_str()) != 0) throw cannot_write(path_, std::strerror(errno));
  temporary_.clear();
}

void write_text_file(const std::string& path, std::string_view text) {
  AtomicFile file(path);
  std::ofstream out(file.temporary_path(), std::ios::binary | std::ios::trunc);
  out.write(text.data(), std::streamsize(text.size()));
  out.close();
  if (!out) throw cannot_write(path, std::strerror(errno));
  file.commit();
}

void require_writable(const std::string& path) { const AtomicFile probe(path); }

}  // namespace fieldtrace
