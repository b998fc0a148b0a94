// Files that appear whole or not at all: written under a temporary name in the same folder, then renamed.
//
// rename(2) replaces its target atomically within one file system, which is why the temporary file lies beside the
// final one and not in /tmp. A symbolic link is followed: what it points to is replaced, not the link.
// Thread-safety: distinct objects are independent, also for the same path: the last commit wins.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fieldtrace {

// One pending write. The destructor removes what was not committed.
class AtomicFile {
 public:
  // Creates the empty temporary file. Throws Error naming `path` and the reason when the folder is missing or not
  // writable, or when `path` is something other than a regular file (a folder, a device).
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // The name to write to; it ends in ".tmp", whatever the format, and fits where the final name does.
  const std::string& temporary_path() const { return temporary_; }

  // Moves the temporary file to its final name once it is on the disk. Throws Error if either fails; call it at most
  // once, after the file has been written and closed, and unless a write has failed.
  void commit();

 private:
  std::string path_;       // as the user wrote it, for messages
  std::string target_;     // path_ with symbolic links resolved
  std::string temporary_;  // empty once committed
};

// A file that remembers the first failure of a write, for libraries that do not tell. Unbuffered. Thread-safety: one
// thread at a time.
class CheckedFile {
 public:
  // Opens an existing file and empties it. A failure is remembered, like that of any other call.
  explicit CheckedFile(const std::string& path);
  ~CheckedFile();
  CheckedFile(const CheckedFile&) = delete;
  CheckedFile& operator=(const CheckedFile&) = delete;

  // Writes all of `data` at `offset`, which may lie anywhere. False once anything has failed.
  bool write_at(uint64_t offset, const void* data, size_t size);
  // Closes the file; it fails too if the file is not as long as what was written.
  void close();
  bool failed() const { return error_ != 0; }
  std::string reason() const;            // of the first failure, as the system words it
  uint64_t end() const { return end_; }  // the offset behind the last byte written

 private:
  int file_ = -1;
  int error_ = 0;
  uint64_t end_ = 0;
};

// Replaces the contents of `path` by `text`. Throws Error if it cannot be written, a full disk included.
void write_text_file(const std::string& path, std::string_view text);

// Throws Error, as writing would, if `path` cannot be written now. Leaves nothing behind and changes no
// existing file: long work calls it before it starts.
void require_writable(const std::string& path);

}  // namespace fieldtrace
