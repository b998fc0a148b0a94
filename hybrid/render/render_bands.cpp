// The tiles of a picture in bands of many, for a device: a band's batches go from surface to surface together, so that
// the questions about their light are waves of k_wave_samples light samples and more (hybrid/visibility). A band holds
// fewer only at the end of the picture. What it takes of memory: docs/gpu.md.

#include <algorithm>
#include <deque>
#include <memory>
#include <mutex>

#include "core/platform/parallel.h"
#include "hybrid/render/render_tiles.h"

namespace fieldtrace {
namespace {

// Bands under way at once: while some wait for the device, the CPU works on the others (decision 040).
constexpr size_t k_bands = 4;

// The light samples of a band, in waves: most shading points have no occluder to be asked about, so a band holds more
// than a wave where its camera samples are few enough for that, those of a quarter of a wave.
constexpr uint64_t k_most_waves_a_band = 4;

// What a camera sample is counted as: its light samples or, if more, those of a glossy lobe.
uint64_t samples_of_camera_sample(const Job& job) {
  return uint64_t(std::max(job.context.settings.light_samples, job.context.settings.lobe_samples));
}

uint64_t samples_of_band(const Job& job) {
  const uint64_t wave = std::max<uint64_t>(job.picture.options.wave_samples, 1);
  const uint64_t waves = samples_of_camera_sample(job) / k_most_waves_a_band;
  return wave * std::clamp<uint64_t>(waves, 1, k_most_waves_a_band);
}

struct TileOfBand {
  size_t tile = 0;
  TileSums sums;
  uint64_t samples = 0;  // light samples, or those of lobes
};

struct BatchOfBand {
  TileOfBand* tile = nullptr;
  CameraSamples samples;
  std::vector<PixelRun> runs;
  std::vector<Rgb> radiance;
};

// Hands out runs of tiles.
class TileRuns {
 public:
  TileRuns(Job& job, const Pass& pass) : job_(job), pass_(pass), tiles_(picture_tiles(job.picture)) {}

  // The next tiles of a band, or all that are left.
  std::deque<TileOfBand> take(uint64_t band_samples) {
    const std::lock_guard lock(mutex_);
    std::deque<TileOfBand> run;
    for (uint64_t samples = 0; next_ < pass_.tiles.size() && samples < band_samples; ++next_) {
      TileOfBand& t = run.emplace_back();
      t.tile = pass_.tiles[next_];
      begin_tile(job_, pass_, tiles_[t.tile], t.sums);
      for (const SampleRange& range : t.sums.ranges) t.samples += range.count;
      t.samples *= samples_of_camera_sample(job_);
      samples += t.samples;
    }
    return run;
  }

 private:
  Job& job_;
  const Pass& pass_;
  const std::vector<Rect> tiles_;
  std::mutex mutex_;
  size_t next_ = 0;
};

// The batches of some tiles, in order.
class TileBatches {
 public:
  TileBatches(const Job& job, std::deque<TileOfBand>& tiles)
      : lobe_samples_(job.context.settings.lobe_samples), by_blocks_(job.context.traces_blocks()), tiles_(tiles) {}

  bool next(BatchOfBand& batch) {
    for (; tile_ < tiles_.size(); ++tile_, batches_.reset()) {
      TileOfBand& t = tiles_[tile_];
      if (!batches_) {
        batches_ = std::make_unique<PixelBatches>(t.sums.pixels, t.sums.ranges, Sequences{}, lobe_samples_, by_blocks_);
      }
      if (!batches_->next(batch.samples, batch.runs)) continue;
      batch.tile = &t;
      return true;
    }
    return false;
  }

 private:
  const int lobe_samples_;
  const bool by_blocks_;
  std::deque<TileOfBand>& tiles_;
  size_t tile_ = 0;
  std::unique_ptr<PixelBatches> batches_;
};

class BandTracer {
 public:
  explicit BandTracer(Job& job) : job_(job) {}

  // Traces all samples of some tiles, in bands of at least `band_samples` light samples if there are as many. Calls
  // finished(tile) for each in order. Returns false if it was stopped.
  template <class Finished>
  bool trace(std::deque<TileOfBand>& tiles, uint64_t band_samples, const Finished& finished) {
    uint64_t all = 0;
    for (const TileOfBand& t : tiles) all += t.samples;
    const uint64_t bands = std::max<uint64_t>(all / band_samples, 1);
    TileBatches batches(job_, tiles);
    size_t next = 0;  // tile to finish
    std::deque<BatchOfBand> band;
    bool has_more = true;
    while (has_more) {
      band.clear();
      uint64_t samples = 0;
      while (has_more && samples < (all + bands - 1) / bands) {
        has_more = batches.next(band.emplace_back());
        if (!has_more) break;
        samples += band.back().samples.size * samples_of_camera_sample(job_);
      }
      if (!has_more) band.pop_back();
      if (!job_.goes_on()) return false;
      trace(band);
      const TileOfBand* const open = has_more && !band.empty() ? band.back().tile : nullptr;
      for (; next < tiles.size() && &tiles[next] != open; ++next) finished(tiles[next]);
    }
    return true;
  }

  void merge_counters(Stats& stats) const {
    for (const TransportWorker& worker : workers_) stats.merge_counters(worker.stats());
  }

 private:
  void trace(std::deque<BatchOfBand>& band) {
    while (workers_.size() < band.size()) workers_.emplace_back(job_.context);
    std::vector<TransportWorker::Batch> batches;
    for (size_t i = 0; i < band.size(); ++i) {
      band[i].radiance.resize(band[i].samples.size);
      batches.push_back({workers_[i], band[i].samples, band[i].radiance});
    }
    TransportWorker::trace(batches);
    for (size_t i = 0; i < band.size(); ++i) {
      const BatchOfBand& batch = band[i];
      add_runs(batch.runs, batch.radiance, workers_[i].first_hits(),
               [&](const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit> firsts) {
                 batch.tile->sums.add(job_, run, radiance, firsts, workers_[i].sample_cost());
               });
    }
  }

  Job& job_;
  std::deque<TransportWorker> workers_;
};

}  // namespace

void trace_bands(Job& job, const Pass& pass, const std::function<void(size_t tile, const TileSums&)>& finished,
                 const std::function<void(size_t tiles)>& progress, Stats& stats) {
  const uint64_t samples = samples_of_band(job);
  TileRuns runs(job, pass);
  std::atomic<size_t> done = 0;
  std::vector<std::unique_ptr<BandTracer>> tracers;
  while (tracers.size() < k_bands) tracers.push_back(std::make_unique<BandTracer>(job));
  parallel_for_isolated(k_bands, [&](size_t i) {
    for (auto run = runs.take(samples); !run.empty() && !job.interrupted; run = runs.take(samples)) {
      const bool is_done = tracers[i]->trace(run, samples, [&](const TileOfBand& t) {
        finished(t.tile, t.sums);
        progress(++done);
      });
      if (!is_done) job.interrupted = true;
    }
  });
  for (const auto& tracer : tracers) tracer->merge_counters(stats);
}

}  // namespace fieldtrace
