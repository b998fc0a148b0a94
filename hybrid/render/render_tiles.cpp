#include "hybrid/render/render_tiles.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <mutex>
#include <numeric>

#include "core/platform/parallel.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// The pixels to trace for a window: whole blocks of the film, since irradiance is fitted, or clusters lie, in these.
// Where candidates may overflow, a ray's test depends on its group, and the groups on the tile; whole tiles of the film
// are traced then, so that a pixel is the same in every window.
Rect traced_window(const Scene& scene, const Rect& window) {
  const int unit = scene.instances.size() <= k_most_candidates ? k_block_size : k_tile_size;
  const auto floor_to_unit = [unit](int v) { return v / unit * unit; };
  const auto end = [&](int last, int film) { return std::min(floor_to_unit(last) + unit, film); };
  const int x = floor_to_unit(window.x), y = floor_to_unit(window.y);
  return {x, y, end(window.x + window.width - 1, scene.film.width) - x,
          end(window.y + window.height - 1, scene.film.height) - y};
}

// Returns false if it was stopped.
bool trace_tile(Job& job, const Pass& pass, const Rect& tile, TransportWorker& worker, TileSums& result) {
  begin_tile(job, pass, tile, result);
  const auto add = [&](const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit> firsts) {
    result.add(job, run, radiance, firsts, worker.sample_cost());
  };
  return trace_pixels(
      result.pixels, result.ranges, Sequences{}, job.context.settings.lobe_samples, worker,
      [&] { return job.goes_on(); }, add);
}

// Indices of the picture's tiles that its slice has, or of all.
std::vector<size_t> tiles_to_trace(const Picture& picture, const std::vector<Rect>& tiles) {
  std::vector<size_t> chosen(tiles.size());
  std::iota(chosen.begin(), chosen.end(), size_t(0));
  if (!picture.options.slice || tiles.empty()) return chosen;
  const auto in_first_row = [&](const Rect& tile) { return tile.y == tiles[0].y; };
  const auto columns = int(std::count_if(tiles.begin(), tiles.end(), in_first_row));
  const std::vector<int> slices = slices_of_tiles(columns, int(tiles.size()) / columns, picture.options.slice->count);
  std::erase_if(chosen, [&](size_t i) { return slices[i] != picture.options.slice->number; });
  return chosen;
}

}  // namespace

Rect traced_pixels(const Picture& picture) {
  return picture.by_rounds() ? picture.window : traced_window(picture.scene, picture.window);
}

void begin_tile(const Job& job, const Pass& pass, const Rect& tile, TileSums& sums) {
  sums.pixels = tile_pixels(tile, job.context.traces_blocks());
  sums.sums.assign(sums.pixels.size(), {});
  sums.aovs.assign(job.context.settings.first_hits ? sums.pixels.size() : 0, {});
  sums.in_quarters = pass.in_quarters;
  sums.ranges.clear();
  for (const PixelPosition& p : sums.pixels) sums.ranges.push_back(pass.samples(p));
}

void TileSums::add(Job& job, const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit> firsts,
                   const TransportWorker::Cost& cost) {
  PixelSums& s = sums[run.pixel];
  const uint64_t not_finite = in_quarters
                                  ? s.add_of(run.first, ranges[run.pixel].end(), radiance, cost.work, cost.seconds)
                                  : s.add(0, radiance, cost.work, cost.seconds);
  if (not_finite > 0) job.not_finite += not_finite;
  for (const FirstHit& first : firsts) aovs[run.pixel].add(first);
}

std::vector<Rect> picture_tiles(const Picture& picture) { return make_tiles(traced_pixels(picture), k_tile_size); }

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

void write_pixel(const Picture& picture, const PixelPosition& p, const PixelSums& sums, const AovSums* aovs,
                 double decay, Image& image) {
  static const AovSums no_layers;
  float* const out = image.pixel(p.x - picture.window.x, p.y - picture.window.y);
  write_pixel(sums, aovs ? *aovs : no_layers, picture.aovs, decay, out);
}

void show_tile(const Picture& picture, const Rect& tile, const std::function<Rgb(const PixelPosition&)>& radiance) {
  if (!picture.callbacks.tile) return;
  std::vector<Rgb> pixels;
  const Rect& w = picture.window;
  const int left = std::max(tile.x, w.x), right = std::min(tile.x + tile.width, w.x + w.width);
  const int top = std::max(tile.y, w.y), bottom = std::min(tile.y + tile.height, w.y + w.height);
  if (left >= right || top >= bottom) return;
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) pixels.push_back(radiance({x, y}));
  }
  picture.callbacks.tile({left - w.x, top - w.y, right - left, bottom - top}, pixels);
}

void trace_tiles(Job& job, const Pass& pass, const std::function<void(size_t tile, const TileSums&)>& finished,
                 const std::function<void(size_t tiles)>& progress, Stats& stats) {
  struct Worker {
    explicit Worker(const TransportContext& context) : transport(context) {}
    TransportWorker transport;
    TileSums sums;
  };
  if (job.context.answerer.device()) return trace_bands(job, pass, finished, progress, stats);
  const std::vector<Rect> tiles = picture_tiles(job.picture);
  std::atomic<size_t> done = 0;
  tbb::enumerable_thread_specific<Worker> workers([&] { return Worker(job.context); });
  parallel_for_isolated(pass.tiles.size(), [&](size_t i) {
    if (job.interrupted) return;
    Worker& worker = workers.local();
    if (trace_tile(job, pass, tiles[pass.tiles[i]], worker.transport, worker.sums)) {
      finished(pass.tiles[i], worker.sums);
      progress(++done);
    } else {
      job.interrupted = true;
    }
  });
  for (const Worker& worker : workers) stats.merge_counters(worker.transport.stats());
}

void render_tiles(Job& job, Image& image, Stats& stats) {
  const Picture& picture = job.picture;
  Pass pass;
  pass.samples = [&](const PixelPosition&) { return SampleRange{0, uint32_t(picture.spp)}; };
  const std::vector<Rect> tiles = picture_tiles(picture);
  pass.tiles = tiles_to_trace(picture, tiles);
  const auto finished = [&](size_t index, const TileSums& tile) {
    job.has_samples = true;
    for (size_t i = 0; i < tile.pixels.size(); ++i) {
      if (contains(picture.window, tile.pixels[i]))
        write_pixel(picture, tile.pixels[i], tile.sums[i], tile.aovs.empty() ? nullptr : &tile.aovs[i], 1.0, image);
    }
    show_tile(picture, tiles[index], [&](const PixelPosition& p) {
      const float* const rgb = image.pixel(p.x - picture.window.x, p.y - picture.window.y);
      return Rgb(rgb[0], rgb[1], rgb[2]);
    });
  };
  Progress progress(picture.callbacks);
  trace_tiles(
      job, pass, finished, [&](size_t done) { progress.report(double(done) / double(pass.tiles.size())); }, stats);
}

struct Progress::State {
  const RenderCallbacks& callbacks;
  std::mutex mutex;
  Clock::time_point last = Clock::now();
  float reported = 0.0f;
};

Progress::Progress(const RenderCallbacks& callbacks) : state_(new State{callbacks, {}}) {}
Progress::~Progress() = default;

void Progress::report(double share) {
  State& s = *state_;
  if (!s.callbacks.progress) return;
  const std::unique_lock lock(s.mutex, std::try_to_lock);
  if (!lock || (share < 1.0 && Clock::now() - s.last < std::chrono::milliseconds(100))) return;
  s.last = Clock::now();
  // A thread that waited for the lock may hold an older share.
  s.reported = std::max(s.reported, float(std::min(share, 1.0)));
  s.callbacks.progress(s.reported, "render");
}

void warn_of_not_finite(const Job& job) {
  if (job.not_finite == 0) return;
  warn(job.picture.callbacks.warning, {},
       std::to_string(job.not_finite) + " camera samples were not finite and count as black; please report the scene");
}

}  // namespace fieldtrace
