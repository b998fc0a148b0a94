#include "hybrid/render/render_rounds.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <shared_mutex>

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "hybrid/film/sample_allocation.h"

namespace fieldtrace {
namespace {

// The first round of rays takes this share of the samples that the picture is expected to need; where fields answer,
// all of them, because each round asks them anew;
constexpr double k_first_share = 1.0 / 8.0;
// but no more than this,
constexpr double k_most_first = 16.0;
// and later rounds multiply a pixel's samples by this at most.
constexpr double k_round_growth = 4.0;
// Of windows of fewer pixels the first round takes at least so many samples: fewer tell nothing of their noise.
constexpr double k_fewest_seen = 256.0;
// Tiles sum their cells at once.
static_assert(k_tile_size % k_noise_block == 0);

// A round plans to use this share of the time that is left; none begins within that share of the whole.
constexpr double k_round_time = 0.9;
constexpr double k_least_time = 0.02;

// The rounds of one picture.
class Rounds {
 public:
  Rounds(Job& job, Checkpoint state, Stats& stats)
      : job_(job),
        picture_(job.picture),
        options_(job.picture.options),
        stats_(stats),
        tiles_(picture_tiles(job.picture)),
        state_(std::move(state)),
        noise_sums_(picture_.window, picture_.options.error_measure),
        progress_(picture_.callbacks) {
    if (state_.film.pixels.empty()) {
      begin();
    } else {
      const auto& pixels = state_.film.pixels;
      job_.has_samples = std::any_of(pixels.begin(), pixels.end(), [](const PixelSums& p) { return p.samples() > 0; });
      for (const Rect& tile : tiles_) show(tile);
      if (picture_.by_rounds()) {
        noise_sums_.sum(state_.film);
        work_before_ = allocation().work();
      }
    }
  }

  void render() {
    if (!is_any(state_.counts)) state_.counts = next();  // a finished picture, resumed for more
    while (!job_.interrupted && is_any(state_.counts)) {
      trace();
      if (job_.interrupted) break;
      state_.counts = next();
      state_.tiles_done.assign(tiles_.size(), 0);
      state_.round += 1;
    }
    keep(/*now=*/true);
    if (job_.interrupted && job_.timed_out() && !picture_.stopped()) job_.interrupted = false;
  }

  void write(Image& image) {
    const FilmSums& film = state_.film;
    const Rect& w = film.window;
    // One sample of each pixel, of which the pixels tell nothing.
    const bool is_one_each = picture_.by_rounds() && has_one_sample() && state_.round == 1;
    const double decay = picture_.by_rounds() && !is_one_each ? allocation().decay() : 1.0;
    parallel_for(size_t(w.height), [&](size_t row) {
      const int y = w.y + int(row);
      for (int x = w.x; x < w.x + w.width; ++x) {
        const size_t i = film.index(x, y);
        if (picture_.aovs.empty()) {
          const Rgb mean(film.pixels[i].mean());
          std::copy_n(&mean.x, 3, image.pixel(x - w.x, y - w.y));
        } else {
          const AovSums* const aovs = film.aovs.empty() ? nullptr : &film.aovs[i];
          write_pixel(picture_, {x, y}, film.pixels[i], aovs, decay, image);
        }
      }
    });
    if (!picture_.by_rounds()) {
      stats_.spp = int(film.pixels[0].samples());
      return;
    }
    stats_.by_rounds = true;
    stats_.rounds = state_.round;
    stats_.samples_mean = 1.0;
    stats_.samples_fewest = stats_.samples_most = 1;
    if (!is_one_each) {
      stats_.samples_mean = allocation().mean_samples();
      stats_.samples_fewest = allocation().fewest_samples();
      stats_.samples_most = allocation().most_samples();
    }
    // Pixels of fewer than two samples tell nothing of their noise, unless a survey did.
    const bool is_known = stats_.samples_fewest >= (has_one_sample() ? 1u : 2u);
    const double square = is_known ? noise() : std::numeric_limits<double>::infinity();
    stats_.error_noise = std::sqrt(square);
    stats_.error_fields = std::sqrt(state_.field_mean_square);
    stats_.error_estimate = std::sqrt(square + state_.field_mean_square);
    if (stats_.samples_fewest == 0 && job_.timed_out())
      warn(picture_.callbacks.warning, {}, "the time was up before all of the picture was traced; the rest is black");
  }

 private:
  static bool is_any(const std::vector<uint32_t>& counts) {
    return std::any_of(counts.begin(), counts.end(), [](uint32_t n) { return n > 0; });
  }

  void begin() {
    state_.film = FilmSums(picture_.window, job_.context.settings.first_hits);
    state_.tiles_done.assign(tiles_.size(), 0);
    if (picture_.by_rounds()) {
      const double expected = std::min(double(state_.expected_samples), double(picture_.most_samples));
      const double share = job_.context.has_fields() ? 1.0 : k_first_share;
      const double most = std::clamp(double(picture_.most_samples), 2.0, k_most_first);
      const double nearest = nearest_power(std::clamp(expected * share, 2.0, most));
      const double first = nearest > most ? 0.5 * nearest : nearest;
      // With a time limit, all pixels have something soon.
      const double least = std::exp2(std::ceil(std::log2(k_fewest_seen / double(state_.film.pixels.size()))));
      if (least > 1.0) state_.first_mean_square = 0.0;
      const uint32_t count = has_one_sample() ? 1 : job_.deadline ? 2 : uint32_t(first);
      const uint32_t most_samples = std::bit_floor(uint32_t(std::max(picture_.most_samples, 2)));
      state_.counts.assign(cells().count(),
                           std::clamp(uint32_t(std::max(least, 1.0)), count, std::max(count, most_samples)));
      if (has_one_sample()) expected_ = 1.0;
    } else {
      state_.counts.assign(1, uint32_t(picture_.most_samples));
    }
  }

  const NoiseCells& cells() const { return noise_sums_.cells(); }

  // Whether pixels have one sample at most, of whose noise a survey tells.
  bool has_one_sample() const {
    return state_.first_mean_square > 0.0 && (state_.round == 0 || (state_.round == 1 && !is_any(state_.counts)));
  }

  // The mean square error that noise makes.
  double noise() { return has_one_sample() ? state_.first_mean_square : allocation().mean_square(); }

  // Of all samples so far.
  const SampleAllocation& allocation() {
    if (!allocation_) allocation_.emplace(noise_sums_, state_.decay, most_decay(job_.context.has_fields()));
    return *allocation_;
  }

  // The samples of a pixel that the round adds, which go on where those before have ended.
  SampleRange samples_of(const PixelPosition& p) const {
    const FilmSums& film = state_.film;
    const bool is_begun = state_.round > 0 && contains(film.window, p);
    const uint32_t done = is_begun ? film.pixels[film.index(p.x, p.y)].samples() : 0;
    return {done, state_.counts[picture_.by_rounds() ? cells().cell(p.x, p.y) : 0]};
  }

  void trace() {
    allocation_.reset();
    Pass pass;
    pass.in_quarters = picture_.by_rounds();
    pass.samples = [&](const PixelPosition& p) { return samples_of(p); };
    for (size_t i = 0; i < tiles_.size(); ++i) {
      const std::vector<PixelPosition> pixels = tile_pixels(tiles_[i]);
      const bool is_wanted =
          std::any_of(pixels.begin(), pixels.end(), [&](const auto& p) { return samples_of(p).count > 0; });
      if (is_wanted && !state_.tiles_done[i]) pass.tiles.push_back(i);
    }
    const auto finished = [&](size_t tile, const TileSums& sums) {
      job_.has_samples = true;
      {
        const std::shared_lock lock(mutex_);
        add(sums);
        if (picture_.by_rounds()) noise_sums_.sum(state_.film, tiles_[tile]);
        state_.tiles_done[tile] = 1;
      }
      const std::lock_guard lock(mutex_);
      show(tiles_[tile]);
      keep(/*now=*/false);
    };
    const auto progress = [&](size_t done) {
      const double share = double(done) / double(pass.tiles.size());
      progress_.report(picture_.by_rounds() ? done_ + (expected_ - done_) * share : share);
    };
    trace_tiles(job_, pass, finished, progress, stats_);
  }

  void add(const TileSums& tile) {
    FilmSums& film = state_.film;
    for (size_t i = 0; i < tile.pixels.size(); ++i) {
      if (!contains(film.window, tile.pixels[i])) continue;
      const size_t at = film.index(tile.pixels[i].x, tile.pixels[i].y);
      if (state_.round == 0) {
        // Not read before: memory that is written first is zeroed once, and not mapped twice.
        film.pixels[at] = tile.sums[i];
        if (!tile.aovs.empty()) film.aovs[at] = tile.aovs[i];
      } else {
        PixelSums sums = film.pixels[at];
        sums.append(tile.sums[i]);
        film.pixels[at] = sums;
        if (!tile.aovs.empty()) film.aovs[at].merge(tile.aovs[i]);
      }
    }
  }

  void show(const Rect& tile) const {
    const FilmSums& film = state_.film;
    show_tile(picture_, tile, [&](const PixelPosition& p) { return Rgb(film.pixels[film.index(p.x, p.y)].mean()); });
  }

  // Writes a checkpoint if one is due.
  void keep(bool now) {
    if (options_.checkpoint.empty() || state_.identity.empty()) return;
    if (!now && seconds_since(kept_) < options_.checkpoint_seconds) return;
    if (job_.keeps_at_end && (!now || job_.interrupted)) return;
    // What fields that outgrew their memory show depends on the threads, and is about to be given up.
    if (job_.budget.exceeded()) return;
    try {
      write_checkpoint(options_.checkpoint, state_);
    } catch (const std::exception& error) {
      warn(picture_.callbacks.warning, {}, error.what() + std::string(now ? "" : "; the render goes on without it"));
    }
    kept_ = Clock::now();
  }

  // Further samples of a pixel (by rounds: by cell); all 0: the picture is done.
  std::vector<uint32_t> next() {
    if (!picture_.by_rounds()) {
      const uint32_t done = state_.film.pixels[0].samples();
      return {uint32_t(std::max(picture_.most_samples - int(done), 0))};
    }
    const double noise = this->noise();
    std::vector<uint32_t> none(cells().count(), 0);
    const bool has_target = options_.target_error > 0.0f;
    const double target = has_target ? double(options_.target_error) * double(options_.target_error) : 0.0;
    const double noise_target = std::max(target - state_.field_mean_square, 0.0);
    if (has_target && state_.field_mean_square >= target) {
      warn(picture_.callbacks.warning, {},
           "fields alone err by " + std::to_string(std::sqrt(state_.field_mean_square)) +
               ", so more samples cannot reach the target error; render the picture again without --resume");
      return none;
    }
    if (has_one_sample()) return std::vector<uint32_t>(cells().count(), noise > noise_target ? 1 : 0);
    const SampleAllocation& allocation = this->allocation();
    SampleAllocation::Limits limits;
    limits.mean_square = noise_target;
    limits.growth = k_round_growth;
    limits.most = double(picture_.most_samples);
    const double work = allocation.work();
    double time_share = 0.0;
    if (job_.deadline) {
      const double left = -seconds_since(*job_.deadline);
      if (left < k_least_time * double(options_.time_limit)) return none;
      limits.work = k_round_time * left * (work - work_before_) / seconds_since(begin_);
      time_share = 1.0 - left / double(options_.time_limit);
    }
    std::vector<uint32_t> counts = allocation.further(limits);
    const double reached = has_target && noise > noise_target ? noise_target / noise : has_target ? 1.0 : 0.0;
    done_ = std::min(std::max({done_, reached, time_share}), 1.0);
    expected_ = std::clamp(done_ * (1.0 + allocation.work_of(counts) / work), done_, 1.0);
    return counts;
  }

  Job& job_;
  const Picture& picture_;
  const RenderOptions& options_;
  Stats& stats_;
  const std::vector<Rect> tiles_;
  Checkpoint state_;
  NoiseSums noise_sums_;  // of the film, by rounds
  Progress progress_;
  std::shared_mutex mutex_;  // shared: of those who add a tile
  const Clock::time_point begin_ = Clock::now();
  Clock::time_point kept_ = begin_;
  std::optional<SampleAllocation> allocation_;  // made when it is asked for
  double work_before_ = 0.0;
  double done_ = 0.0, expected_ = 0.1;  // shares of the work, for the progress line
};

}  // namespace

void render_rounds(Job& job, Checkpoint state, Image& image, Stats& stats) {
  Rounds rounds(job, std::move(state), stats);
  rounds.render();
  rounds.write(image);
}

}  // namespace fieldtrace
