#include "hybrid/render/render_rounds.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>

#include "hybrid/film/sample_allocation.h"

namespace fieldtrace {
namespace {

// The first round takes this share of the samples that the picture is expected to need,
constexpr double k_first_share = 1.0 / 8.0;
// but of each half no more than this,
constexpr uint32_t k_most_first = 8;
// and later rounds multiply a pixel's samples by this at most.
constexpr double k_round_growth = 4.0;
// A round plans to use this share of the time that is left; none begins within that share of the whole.
constexpr double k_round_time = 0.9;
constexpr double k_least_time = 0.02;

// The rounds of one picture.
class Rounds {
 public:
  Rounds(Job& job, const RoundsPlan& plan, Stats& stats)
      : job_(job),
        picture_(job.picture),
        options_(job.picture.options),
        stats_(stats),
        film_(job.picture.window, job.context.settings.first_hits),
        cells_(film_.window),
        measure_(options_.error_measure),
        progress_(job.picture.callbacks),
        field_mean_square_(plan.field_mean_square) {}

  void render() {
    const double expected = std::min(double(picture_.spp), double(picture_.most_samples)) * k_first_share;
    const auto first = uint32_t(std::clamp(0.5 * expected, 1.0, double(k_most_first)));
    std::vector<uint32_t> counts(cells_.count(), first);
    for (uint32_t round = 0; std::any_of(counts.begin(), counts.end(), [](uint32_t n) { return n > 0; }); ++round) {
      trace(round, counts);
      if (job_.interrupted) break;
      counts = next();
    }
    if (job_.interrupted && job_.timed_out() && !picture_.stopped()) job_.interrupted = false;
  }

  void write(Image& image) {
    const Rect& w = film_.window;
    for (int y = w.y; y < w.y + w.height; ++y) {
      for (int x = w.x; x < w.x + w.width; ++x) {
        const size_t i = film_.index(x, y);
        write_pixel(picture_, {x, y}, film_.pixels[i], film_.aovs.empty() ? nullptr : &film_.aovs[i], image);
      }
    }
    const SampleAllocation allocation(film_, measure_);
    stats_.rounds = rounds_;
    stats_.error_noise = std::sqrt(allocation.mean_square());
    stats_.error_fields = std::sqrt(field_mean_square_);
    stats_.error_estimate = std::sqrt(allocation.mean_square() + field_mean_square_);
    stats_.samples_mean = allocation.mean_samples();
    stats_.samples_fewest = allocation.fewest_samples();
    stats_.samples_most = allocation.most_samples();
  }

 private:
  // What noise may add to the error of fields.
  double noise_target() const {
    const double target = double(options_.target_error) * double(options_.target_error);
    return std::max(target - field_mean_square_, 0.0);
  }

  void trace(uint32_t round, const std::vector<uint32_t>& counts) {
    const std::vector<Rect> tiles = picture_tiles(picture_);
    Pass pass;
    pass.halves = 2;
    pass.first_replicate = 2 * round;
    pass.samples_of_half = [&](const PixelPosition& p) { return counts[cells_.cell(p.x, p.y)]; };
    for (size_t i = 0; i < tiles.size(); ++i) {
      const std::vector<PixelPosition> pixels = tile_pixels(tiles[i]);
      if (std::any_of(pixels.begin(), pixels.end(), [&](const auto& p) { return pass.samples_of_half(p) > 0; }))
        pass.tiles.push_back(i);
    }
    const auto finished = [&](size_t, const TileSums& tile) {
      const std::lock_guard lock(mutex_);
      for (size_t i = 0; i < tile.pixels.size(); ++i) {
        const size_t at = film_.index(tile.pixels[i].x, tile.pixels[i].y);
        film_.pixels[at].merge(tile.sums[i]);
        if (!tile.aovs.empty()) film_.aovs[at].merge(tile.aovs[i]);
      }
    };
    const auto progress = [&](size_t done) {
      const double share = double(done) / double(pass.tiles.size());
      progress_.report(done_ + (expected_ - done_) * share);
    };
    trace_tiles(job_, pass, finished, progress, stats_);
    ++rounds_;
  }

  // Further samples of each half, by cell; all 0: the picture is done.
  std::vector<uint32_t> next() {
    const SampleAllocation allocation(film_, measure_);
    const double noise = allocation.mean_square();
    std::vector<uint32_t> none(cells_.count(), 0);
    if (options_.target_error > 0.0f && noise <= noise_target()) return none;
    SampleAllocation::Limits limits;
    limits.mean_square = options_.target_error > 0.0f ? noise_target() : 0.0;
    limits.growth = k_round_growth;
    limits.most = double(picture_.most_samples);
    double time_share = 0.0;
    if (job_.deadline) {
      const auto seconds = [](Clock::duration d) { return std::chrono::duration<double>(d).count(); };
      const double left = seconds(*job_.deadline - Clock::now());
      if (left < k_least_time * double(options_.time_limit)) return none;
      limits.work = k_round_time * left / (seconds(Clock::now() - begin_) / allocation.work());
      time_share = 1.0 - left / double(options_.time_limit);
    }
    std::vector<uint32_t> counts = allocation.further(limits);
    const double work = allocation.work(), more = allocation.work_of(counts);
    done_ = std::max({done_, options_.target_error > 0.0f ? noise_target() / noise : 0.0, time_share});
    expected_ = std::max(done_, std::min(done_ * (work + more) / work, 1.0));
    return counts;
  }

  Job& job_;
  const Picture& picture_;
  const RenderOptions& options_;
  Stats& stats_;
  FilmSums film_;
  NoiseCells cells_;
  ErrorMeasure measure_;
  Progress progress_;
  double field_mean_square_ = 0.0;
  std::mutex mutex_;
  Clock::time_point begin_ = Clock::now();
  uint32_t rounds_ = 0;
  double done_ = 0.0, expected_ = 0.1;  // shares of the work, for the progress line
};

}  // namespace

void render_rounds(Job& job, const RoundsPlan& plan, Image& image, Stats& stats) {
  Rounds rounds(job, plan, stats);
  rounds.render();
  rounds.write(image);
}

}  // namespace fieldtrace
