// The trade-off between speed and accuracy, measured: one scene is rendered by both methods over sample counts,
// tolerances and field resolutions, and to errors that are asked for, and each picture compared with a Monte Carlo
// reference of the same renderer. With several seeds its error is told apart into bias and variance.
//
// Cold: with an empty field cache. Warm: a second render with the cache that the first one left. Times are wall seconds
// of render() alone, because loading the scene and writing images cost the same in all rows.
// Thread-safety: functions may run concurrently on different scenes, but then disturb each other's times.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/scene/scene.h"
#include "hybrid/compare/compare.h"
#include "hybrid/compare/error_parts.h"
#include "hybrid/render/render.h"

namespace fieldtrace {

// What a row was measured for.
enum class Ladder {
  samples,     // over numbers of camera samples, and tolerances
  resolution,  // over field resolutions
  target,      // pictures to an error (RenderOptions::target_error)
  time         // pictures in a time (RenderOptions::time_limit), rendered cold alone
};

inline bool is_hybrid(const RenderOptions& options) { return options.method == Method::hybrid; }

struct TradeoffCase {
  RenderOptions options;
  Ladder ladder = Ladder::samples;
};

struct TradeoffRow {
  RenderOptions options;
  Ladder ladder = Ladder::samples;
  Stats cold, warm;                           // warm equals cold for Monte Carlo, which has no cache
  double seconds_cold = 0, seconds_warm = 0;  // of the whole render() call
  ImageDifference difference;                 // of the cold picture against the reference
  double flip = 0, hdr_flip = 0;              // the same, means
};

// Bias and variance of one configuration.
struct TradeoffParts {
  RenderOptions options;
  int seeds = 0;
  ErrorParts parts;
};

// Monte Carlo's rows come first, each ladder's hybrid rows later.
struct TradeoffPlan {
  // Monte Carlo with many samples and a seed that no case uses; in halves, of which the second has the next seed, where
  // bias and variance need them.
  RenderOptions reference;
  // The configurations to measure. `field_cache` is ignored: each gets a temporary folder.
  std::vector<TradeoffCase> cases;
  // Errors that pictures are rendered to, by both methods, relative to the least error of Monte Carlo among the cases.
  std::vector<double> targets;
  RenderOptions target_options;  // what these have in common; the rest as it is for users, by default
  // Also one picture of each method in the time that the hybrid took, cold, for the middle target.
  bool equal_time = false;
  // The configurations whose bias and variance are told apart, from pictures with so many seeds, 2 at least.
  std::vector<RenderOptions> parts;
  int seeds = 0;
};

// The cases of the command line. Quick: few samples, two field resolutions, a reference of 256 samples. Full: Monte
// Carlo with 1 to 256 samples; hybrid with 1 to 64 samples x tolerances 0, 0.05, 0.1, 0.25, 0.5, 1 at the scene's
// default field resolution, and 16 samples x D in {32, 64, 128} x N in {64, 128, 256}; a reference of 4096 samples.
// `base` gives threads, instruction set, light samples and the seed; the reference takes the next two seeds, pictures
// of several seeds those behind.
struct TradeoffPlanOptions {
  bool quick = false;
  RenderOptions base;
};
TradeoffPlan make_tradeoff_plan(const Scene& scene, const TradeoffPlanOptions& options = {});

struct TradeoffReference {
  Image image;
  Image
      halves[2];  // two pictures with different seeds and half the samples, whose mean it is; empty: it is in one piece
};

struct TradeoffCallbacks {
  RenderCallbacks render;  // progress is that of the whole plan
  // Called once the reference is rendered, before the first case. Not for one that was given.
  std::function<void(const Image& reference)> reference;
  // Called after each case, in order, with its cold picture.
  std::function<void(const TradeoffRow& row, const Image& image)> row;
  std::function<void(const TradeoffParts& parts)> parts;
};

// Renders the reference unless `reference` already holds it, then each case cold and warm, then what bias and variance
// take. Returns true if all was measured, false if callbacks.render.stop ended the run early: an interrupted case
// yields no row. Temporary caches lie in `scratch_folder`, which must exist, and are removed. Throws what render() and
// compare_images() throw.
bool run_tradeoff(const Scene& scene, const TradeoffPlan& plan, const std::string& scratch_folder,
                  TradeoffReference& reference, const TradeoffCallbacks& callbacks);

struct ErrorPoint {
  double seconds = 0, rmse = 0;
};

// The time that Monte Carlo needs to reach an error, as far as the measured points tell.
struct TimeAtError {
  enum class Relation { equals, more_than, less_than };
  double seconds = 0;  // NaN: unknown
  Relation relation = Relation::equals;
};

// Seconds that Monte Carlo needs to reach `rmse`: interpolated between neighbouring points, linearly in log-log.
// Nothing is extrapolated, because there is no single law (the noise of light samples falls faster than samples^-1/2,
// that of pixel edges does not): an error below all measured ones takes more than the time of the least, one above all
// less than the time of the greatest. Points need not be sorted; those without a positive finite time and error are
// ignored. NaN if no point remains or `rmse` is not positive and finite.
TimeAtError seconds_at_error(std::vector<ErrorPoint> points, double rmse);

// The Monte Carlo renders among rows that rows of `ladder` are compared with: those to an error for Ladder::target,
// those of Ladder::samples for all others.
std::vector<ErrorPoint> monte_carlo_points(const std::vector<TradeoffRow>& rows, Ladder ladder = Ladder::samples);

// From how many frames on a cache has paid: the least n with cold + (n - 1) warm < n times Monte Carlo's time at the
// same error, of the same scene or of others with the same objects.
struct FramesToPay {
  // at_most, at_least: where Monte Carlo's time is more, or less, than what was measured.
  enum class Relation { unknown, equals, at_most, at_least, never };
  Relation relation = Relation::unknown;
  double frames = 0;  // of equals, at_most and at_least
};
FramesToPay frames_to_pay(double seconds_cold, double seconds_warm, const TimeAtError& monte_carlo);

// The header and the rows of the table, as lines of CSV without the newline. `monte_carlo`: the points from which the
// time of Monte Carlo at the row's error is interpolated. That time takes two columns, montecarlo_relation (equals,
// more_than or less_than) and montecarlo_seconds; both are empty where it is unknown. So do the frames after which the
// cache has paid, of hybrid rows that baked something and have a warm render.
std::string tradeoff_csv_header();
std::string tradeoff_csv_row(const TradeoffRow& row, const std::vector<ErrorPoint>& monte_carlo);

// The same for bias and variance.
std::string parts_csv_header();
std::string parts_csv_row(const TradeoffParts& parts);

}  // namespace fieldtrace
