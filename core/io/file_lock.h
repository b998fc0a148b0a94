// An advisory lock between threads and processes, held for the lifetime of the object.
//
// Thread-safety: distinct objects exclude one another, within a process or across processes. The system releases the
// lock when its process ends for whatever reason, so no lock is ever stale. The lock file is left in place: removing it
// would let two holders in.
#pragma once

#include <atomic>
#include <string>

namespace fieldtrace {

enum class LockWait { until_free, none };

// Longer than programs that are not stopped hold a lock, one after the other.
inline constexpr double k_longest_lock_wait = 600.0;  // seconds

class FileLock {
 public:
  // Takes the lock on `path`, which is created empty if it does not exist. Waits for it or, with LockWait::none, only
  // tries once. Throws Error if the file cannot be locked, or not within this time or before `stop` (may be null) is
  // set.
  explicit FileLock(const std::string& path, LockWait wait = LockWait::until_free,
                    double most_seconds = k_longest_lock_wait, const std::atomic<bool>* stop = nullptr);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

  bool held() const { return file_ >= 0; }  // always true after waiting

 private:
  int file_ = -1;
};

}  // namespace fieldtrace
