// Writes a picture that is being rendered to image files, every few seconds.
//
// Thread-safety: made and ended by one thread; it writes from a thread of its own.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/image/image.h"
#include "core/platform/error.h"
#include "tools/cli/live_picture.h"

namespace fieldtrace {

struct WatcherOptions {
  std::vector<std::string> paths;  // .png
  float exposure = 0.0f;           // stops
  double seconds = 2.0;            // between the ends and beginnings of writes
};

class PictureWatcher {
 public:
  // Each file is replaced as a whole, if the picture has changed. What cannot be written is told once by `warning`,
  // from the watcher's thread, and tried again.
  PictureWatcher(std::shared_ptr<const LivePicture> picture, WatcherOptions options, WarningSink warning);
  ~PictureWatcher() { stop(); }
  PictureWatcher(const PictureWatcher&) = delete;
  PictureWatcher& operator=(const PictureWatcher&) = delete;

  // Returns when nothing is being written any more.
  void stop();

 private:
  void run();
  bool take_changes();

  const std::shared_ptr<const LivePicture> picture_;
  const WatcherOptions options_;
  const WarningSink warning_;
  Image image_;
  std::vector<uint64_t> seen_;
  std::mutex mutex_;
  std::condition_variable stopped_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace fieldtrace
