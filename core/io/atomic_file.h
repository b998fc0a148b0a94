// Files that appear whole or not at all: written under a temporary name in the same folder, then renamed.
//
// rename(2) replaces its target atomically within one file system only, so the temporary file lies beside the final one
// and not in /tmp. Symbolic links are followed: the file that a link points to is replaced or made, not the link. Files
// that are replaced keep their permissions. A file that may be written but not replaced (a mount, another user's in a
// folder such as /tmp) is written over in place, last.
// Thread-safety: distinct objects are independent, even for the same path, where the last commit wins.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fieldtrace {

// One pending write. The destructor removes the temporary file unless it was committed.
class AtomicFile {
 public:
  // Creates the empty temporary file. Throws Error naming `path` and the reason if the folder is missing or not
  // writable, or if `path` is not a regular file (a folder, a device).
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // The name to write to. It ends in ".tmp" for every format and is short enough wherever the final name is.
  const std::string& temporary_path() const { return temporary_; }

  // Flushes the temporary file to disk and moves it to its final name. Throws Error if either fails; one that is whole
  // but cannot be moved is kept as `path`.whole, and the message says so. Then flushes the
  // folder, so that the name outlasts a crash of the machine, unless the folder may not be read. Call it at most once,
  // after the file has been written without errors and closed.
  void commit();

 private:
  void write_over(int reason);

  std::string path_;       // as the user wrote it, for messages
  std::string target_;     // path_ with symbolic links resolved
  std::string temporary_;  // empty once committed
};

// A file that remembers the first failed write, for libraries that do not report failures. Unbuffered. Thread-safety:
// one thread at a time.
class CheckedFile {
 public:
  // Opens and truncates an existing file. Failure to open is remembered like any other.
  explicit CheckedFile(const std::string& path);
  ~CheckedFile();
  CheckedFile(const CheckedFile&) = delete;
  CheckedFile& operator=(const CheckedFile&) = delete;

  // Writes all of `data` at `offset`, which may lie anywhere. Returns false once anything has failed.
  bool write_at(uint64_t offset, const void* data, size_t size);
  // Closes the file. Fails too if the file is shorter or longer than what was written.
  void close();
  bool failed() const { return error_ != 0; }
  std::string reason() const;            // of the first failure, in the system's words
  uint64_t end() const { return end_; }  // one past the last byte written

 private:
  int file_ = -1;
  int error_ = 0;
  uint64_t end_ = 0;
};

// Replaces the contents of `path` with `text`. Throws Error if it cannot be written, including for a full disk.
void write_text_file(const std::string& path, std::string_view text);

// The absolute path of the file that writing to `path` would replace or make: symbolic links are followed, also the
// last one if what it points to does not exist. Throws Error if more than 40 follow one another.
std::string write_target(const std::string& path);

// Equal for two paths if they are one file, or would be once it is written. Throws Error as write_target().
std::string file_identity(const std::string& path);

// Throws Error, as writing would, if `path` cannot be written now, and if there is a file that may not be written to,
// which writing would replace. Leaves nothing behind and changes no existing file;
// to be called before long work starts.
void require_writable(const std::string& path);

}  // namespace fieldtrace
