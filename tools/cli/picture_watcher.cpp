#include "tools/cli/picture_watcher.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace fieldtrace {

PictureWatcher::PictureWatcher(std::shared_ptr<const LivePicture> picture, WatcherOptions options, WarningSink warning)
    : picture_(std::move(picture)),
      options_(std::move(options)),
      warning_(without_repeats(std::move(warning))),
      seen_(picture_->block_count(), 0) {
  image_.width = picture_->width();
  image_.height = picture_->height();
  image_.channels = {"R", "G", "B"};
  image_.data.assign(size_t(image_.width) * size_t(image_.height) * 3, 0.0f);
  thread_ = std::thread([this] { run(); });
}

void PictureWatcher::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopped_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool PictureWatcher::take_changes() {
  bool changed = false;
  LivePicture::Block block;
  for (size_t b = 0; b < seen_.size(); ++b) {
    if (!picture_->read(b, seen_[b], block)) continue;
    changed = true;
    for (int y = 0; y < block.rect.height; ++y) {
      for (int x = 0; x < block.rect.width; ++x) {
        const Rgb& rgb = block.pixels[size_t(y) * size_t(block.rect.width) + size_t(x)];
        float* const to = image_.pixel(block.rect.x + x, block.rect.y + y);
        for (int c = 0; c < 3; ++c) to[c] = rgb[c];
      }
    }
  }
  return changed;
}

void PictureWatcher::run() {
  const auto interval = std::chrono::duration<double>(options_.seconds);
  ImageWriteOptions write;
  write.exposure = options_.exposure;
  bool is_due = false;
  while (true) {
    {
      std::unique_lock lock(mutex_);
      if (stopped_.wait_for(lock, interval, [&] { return stop_; })) return;
    }
    is_due = take_changes() || is_due;
    if (!is_due) continue;
    is_due = false;
    for (const std::string& path : options_.paths) {
      try {
        write_image(path, image_, write);
      } catch (const std::exception& error) {
        is_due = true;
        warn(warning_, {}, std::string("--watch: ") + error.what() + "; the render goes on");
      }
    }
  }
}

}  // namespace fieldtrace
