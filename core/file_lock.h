// An advisory lock that threads and processes take turns with, held while the object lives.
//
// Thread-safety: distinct objects exclude one another, whether they belong to one process or to several. The system
// lets go of the lock when its process ends, however it ends. The lock file stays: removing it would let two holders
// in.
#pragma once

#include <string>

namespace fieldtrace {

class FileLock {
 public:
  // Waits for the lock on `path`, which is created empty if need be. Throws Error if it cannot be.
  explicit FileLock(const std::string& path);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  int file_ = -1;
};

}  // namespace fieldtrace
