#include "core/io/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "core/platform/error.h"

namespace fieldtrace {

FileLock::FileLock(const std::string& path, LockWait wait) {
  file_ = open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
  // Another user's, perhaps: locks need no right to write.
  const int refused = errno;
  if (file_ < 0 && refused == EACCES) file_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file_ < 0) {
    throw Error({path}, std::string("cannot be written: ") + std::strerror(refused) +
                            " (choose a folder that you may write to)");
  }
  // Each open() creates a separate lock owner, so threads exclude one another as processes do.
  while (flock(file_, wait == LockWait::none ? LOCK_EX | LOCK_NB : LOCK_EX) != 0) {
    if (errno == EINTR) continue;
    const int reason = errno;
    close(file_);
    file_ = -1;
    if (wait == LockWait::none && reason == EWOULDBLOCK) return;
    throw Error({path}, std::string("cannot be locked: ") + std::strerror(reason) +
                            " (choose a folder on a file system with locks)");
  }
}

FileLock::~FileLock() {
  if (file_ >= 0) close(file_);
}

}  // namespace fieldtrace
