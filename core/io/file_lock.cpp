#include "core/io/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <thread>

#include "core/platform/error.h"
#include "core/platform/stopwatch.h"

namespace fieldtrace {

FileLock::FileLock(const std::string& path, LockWait wait, double most_seconds, const std::atomic<bool>* stop) {
  file_ = open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
  // Another user's, perhaps: locks need no right to write.
  const int refused = errno;
  if (file_ < 0 && refused == EACCES) file_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file_ < 0) {
    throw Error({path}, std::string("cannot be written: ") + std::strerror(refused) +
                            " (choose a folder that you may write to)");
  }
  // Each open() creates a separate lock owner, so threads exclude one another as processes do.
  const auto begin = std::chrono::steady_clock::now();
  while (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    const int reason = errno;
    if (reason == EINTR) continue;
    const bool is_taken = reason == EWOULDBLOCK;
    const bool stopped = stop && stop->load(std::memory_order_relaxed);
    const double waited = seconds_since(begin);
    if (is_taken && wait == LockWait::until_free && !stopped && waited < most_seconds) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      continue;
    }
    close(file_);
    file_ = -1;
    if (is_taken && wait == LockWait::none) return;
    if (is_taken) {
      throw Error({path}, "has been locked by other programs for " + std::to_string(std::lround(waited)) +
                              " seconds (if one is stopped, let it go on or end it)");
    }
    throw Error({path}, std::string("cannot be locked: ") + std::strerror(reason) +
                            " (choose a folder on a file system with locks)");
  }
}

FileLock::~FileLock() {
  if (file_ >= 0) close(file_);
}

}  // namespace fieldtrace
