// An advisory lock that threads and processes take turns with, held while the object lives.
//
// Thread-safety: distinct objects exclude one another, whether they belong to one process or to several. The system
// lets go of the lock when its process ends, however it ends: a lock is never stale. The lock file stays: removing it
// would let two holders in.
#pragma once

#include <string>

namespace fieldtrace {

enum class LockWait { until_free, none };

class FileLock {
 public:
  // Takes the lock on `path`, which is created empty if need be: waits for it, or with LockWait::none looks whether it
  // is free. Throws Error if it cannot be locked.
  explicit FileLock(const std::string& path, LockWait wait = LockWait::until_free);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

  bool held() const { return file_ >= 0; }  // always true after waiting

 private:
  int file_ = -1;
};

}  // namespace fieldtrace
