#include "hybrid/render/render_tiles.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>

#include "core/math/finite.h"
#include "core/platform/parallel.h"
#include "hybrid/path/tiles.h"
#include "hybrid/render/trace_pixels.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

using Clock = std::chrono::steady_clock;

// The pixels to trace for a window. Where candidates may overflow, a ray's test depends on its group, and the groups on
// the tile; whole tiles of the film are traced then, so that a pixel is the same in every window.
Rect traced_window(const Scene& scene, const Rect& window) {
  if (scene.instances.size() <= k_most_candidates) return window;
  const auto floor_to_tile = [](int v) { return v / k_tile_size * k_tile_size; };
  const auto end = [&](int last, int film) { return std::min(floor_to_tile(last) + k_tile_size, film); };
  const int x = floor_to_tile(window.x), y = floor_to_tile(window.y);
  return {x, y, end(window.x + window.width - 1, scene.film.width) - x,
          end(window.y + window.height - 1, scene.film.height) - y};
}

bool contains(const Rect& r, const PixelPosition& p) {
  return p.x >= r.x && p.y >= r.y && p.x < r.x + r.width && p.y < r.y + r.height;
}

// Reports progress at most ten times a second, from whichever thread has just finished a tile.
class Progress {
 public:
  Progress(const RenderCallbacks& callbacks, size_t total) : callbacks_(callbacks), total_(total) {}

  void tile_done() {
    const size_t done = ++done_;
    if (!callbacks_.progress) return;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || (done < total_ && Clock::now() - last_ < std::chrono::milliseconds(100))) return;
    last_ = Clock::now();
    // A thread that waited for the lock may hold an older count.
    reported_ = std::max(reported_, float(double(done) / double(total_)));
    callbacks_.progress(reported_, "render");
  }

 private:
  const RenderCallbacks& callbacks_;
  size_t total_;
  std::atomic<size_t> done_ = 0;
  std::mutex mutex_;
  Clock::time_point last_ = Clock::now();
  float reported_ = 0.0f;
};

struct PixelSums {
  DVec3 radiance = DVec3(0.0);
  AovSums aovs;
};

void write_pixel(const Job& job, const PixelPosition& p, const PixelSums& sums) {
  float* out = job.image.pixel(p.x - job.picture.window.x, p.y - job.picture.window.y);
  for (int c = 0; c < 3; ++c) *out++ = float(sums.radiance[c] / job.picture.spp);
  sums.aovs.write(job.picture.aovs, out);
}

// Returns false if it was stopped; the tile then stays black.
bool render_tile(Job& job, const Rect& tile, TransportWorker& worker) {
  const std::vector<PixelPosition> pixels = tile_pixels(tile);
  std::vector<PixelSums> sums(pixels.size());
  const auto goes_on = [&] { return !job.picture.stopped() && !job.budget.exceeded(); };
  const auto add = [&](size_t pixel, std::span<const Rgb> radiance, std::span<const FirstHit> firsts) {
    DVec3 sum = sums[pixel].radiance;
    for (const Rgb& r : radiance) sum += DVec3(r);
    if (!std::isfinite(sum.x + sum.y + sum.z)) {  // never by overflow: the samples are floats
      sum = sums[pixel].radiance;
      for (const Rgb& r : radiance) {
        if (is_finite(r)) {
          sum += DVec3(r);
        } else {
          ++job.not_finite;
        }
      }
    }
    sums[pixel].radiance = sum;
    for (const FirstHit& first : firsts) sums[pixel].aovs.add(first);
  };
  if (!trace_pixels(pixels, job.picture.spp, job.picture.settings.lobe_samples, worker, goes_on, add)) return false;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (contains(job.picture.window, pixels[i])) write_pixel(job, pixels[i], sums[i]);
  }
  return true;
}

}  // namespace

Image make_image(const Rect& window, const std::vector<Aov>& aovs) {
  Image image;
  image.width = window.width;
  image.height = window.height;
  image.channels = {"R", "G", "B"};
  for (const Aov aov : aovs) {
    for (std::string& name : aov_channels(aov)) image.channels.push_back(std::move(name));
  }
  image.data.assign(size_t(window.width) * window.height * image.channel_count(), 0.0f);
  return image;
}

Stats render_tiles(Job& job) {
  const std::vector<Rect> tiles = make_tiles(traced_window(job.picture.scene, job.picture.window), k_tile_size);
  Progress progress(job.picture.callbacks, tiles.size());
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(job.context); });
  parallel_for(tiles.size(), [&](size_t i) {
    if (job.interrupted) return;
    bool done = false;
    // Isolated: a thread that waits for a bake inside a tile must not start another tile with the same worker.
    tbb::this_task_arena::isolate([&] { done = render_tile(job, tiles[i], workers.local()); });
    if (done) {
      progress.tile_done();
    } else {
      job.interrupted = true;
    }
  });
  Stats stats;
  for (const TransportWorker& worker : workers) stats.merge_counters(worker.stats());
  return stats;
}

void warn_of_not_finite(const Job& job) {
  if (job.not_finite == 0) return;
  warn(job.picture.callbacks.warning, {},
       std::to_string(job.not_finite) + " camera samples were not finite and count as black; please report the scene");
}

}  // namespace fieldtrace
