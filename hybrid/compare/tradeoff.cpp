#include "hybrid/compare/tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/io/scratch_folder.h"
#include "core/platform/stopwatch.h"
#include "hybrid/compare/flip.h"

namespace fieldtrace {

namespace {

std::string time_columns(const TimeAtError& time) {
  if (!std::isfinite(time.seconds)) return ",";
  constexpr const char* k_relations[] = {"equals", "more_than", "less_than"};
  return fmt::format("{},{:.6g}", k_relations[int(time.relation)], time.seconds);
}

std::string frames_columns(const FramesToPay& frames) {
  constexpr const char* k_frames[] = {"", "equals", "at_most", "at_least", "never"};
  const bool is_number = frames.frames > 0.0;
  return fmt::format("{},{}", k_frames[int(frames.relation)], is_number ? fmt::format("{:.0f}", frames.frames) : "");
}

// Whether there is a bake that later frames can pay for.
bool has_bake(const TradeoffRow& row) {
  return is_hybrid(row.options) && row.ladder != Ladder::time && row.cold.bake_rays > 0;
}

// Two significant digits.
float rounded(double v) {
  const double unit = std::pow(10.0, std::floor(std::log10(v)) - 1.0);
  return float(std::round(v / unit) * unit);
}

// One run of a plan.
class TradeoffRun {
 public:
  TradeoffRun(const Scene& scene, const TradeoffPlan& plan, const std::string& scratch_folder,
              TradeoffReference& reference, const TradeoffCallbacks& callbacks)
      : scene_(scene), plan_(plan), scratch_folder_(scratch_folder), reference_(reference), callbacks_(callbacks) {}

  bool run() {
    find_total();
    if (reference_.image.data.empty() && !render_reference()) return false;
    const auto measure_cases = [&](bool hybrid) {
      for (const TradeoffCase& c : plan_.cases) {
        if (is_hybrid(c.options) == hybrid && !measure(c)) return false;
      }
      return measure_targets(hybrid ? Method::hybrid : Method::monte_carlo);
    };
    return measure_cases(false) && measure_cases(true) && measure_equal_time() && measure_parts();
  }

 private:
  // Camera samples a pixel: the measure of a render's share in the whole plan. Those of pictures to an error are those
  // that Monte Carlo would need if its noise fell with their root, and but an estimate.
  double work_of(const RenderOptions& options) const {
    if (options.target_error > 0.0f && least_error_ > 0.0) {
      return target_work(double(options.target_error) / least_error_);
    }
    if (options.time_limit > 0.0f) return target_work(middle_target());
    return options.spp > 0 ? options.spp : scene_.sample_count;
  }
  double target_work(double target) const { return most_samples_ / (target * target); }
  double middle_target() const { return plan_.targets.empty() ? 1.0 : plan_.targets[plan_.targets.size() / 2]; }

  void find_total() {
    if (reference_.image.data.empty()) total_ += work_of(plan_.reference);
    for (const TradeoffCase& c : plan_.cases) {
      total_ += work_of(c.options) * (is_hybrid(c.options) ? 2 : 1);
      if (!is_hybrid(c.options)) most_samples_ = std::max(most_samples_, work_of(c.options));
    }
    for (const double t : plan_.targets) total_ += 3.0 * target_work(t);
    if (plan_.equal_time) total_ += 2.0 * target_work(middle_target());
    for (const RenderOptions& o : plan_.parts) total_ += work_of(o) * plan_.seeds;
  }

  // Renders and times one case, then advances the progress by its whole work.
  RenderResult render_timed(const RenderOptions& options, const char* label, double& seconds) {
    const double work = work_of(options);
    RenderCallbacks callbacks = callbacks_.render;
    callbacks.progress = [&](float share, const char*) {
      if (callbacks_.render.progress)
        callbacks_.render.progress(float(std::min((done_ + share * work) / total_, 1.0)), label);
    };
    const auto start = std::chrono::steady_clock::now();
    RenderResult result = render(scene_, options, callbacks);
    seconds = seconds_since(start);
    done_ += work;
    return result;
  }

  bool render_reference() {
    double seconds = 0;
    const int pictures = plan_.seeds >= 2 ? 2 : 1;
    RenderOptions options = plan_.reference;
    options.spp = std::max(1, (plan_.reference.spp + pictures - 1) / pictures);
    for (int i = 0; i < pictures; ++i) {
      options.seed = plan_.reference.seed.value_or(scene_.seed) + uint32_t(i);
      RenderResult result = render_timed(options, "reference", seconds);
      if (result.interrupted) return false;
      reference_.halves[i] = std::move(result.image);
    }
    if (pictures == 1) {
      reference_.image = std::move(reference_.halves[0]);
      reference_.halves[0] = {};
    } else {
      reference_.image = reference_.halves[0];
      for (size_t i = 0; i < reference_.image.data.size(); ++i) {
        reference_.image.data[i] = 0.5f * (reference_.halves[0].data[i] + reference_.halves[1].data[i]);
      }
    }
    if (callbacks_.reference) callbacks_.reference(reference_.image);
    return true;
  }

  bool measure(const TradeoffCase& c) {
    const bool hybrid = is_hybrid(c.options);
    const ScratchFolder cache(scratch_folder_, "field-cache");
    TradeoffRow row;
    row.options = c.options;
    row.ladder = c.ladder;
    row.options.field_cache = hybrid ? cache.path() : std::string();
    row.options.if_unkept = IfUnkept::fail;  // a warm row without them would be a cold one
    RenderResult cold = render_timed(row.options, hybrid ? "hybrid, cold" : "Monte Carlo", row.seconds_cold);
    if (cold.interrupted) return false;
    row.cold = row.warm = cold.stats;
    row.seconds_warm = row.seconds_cold;
    row.difference = compare_images(cold.image, reference_.image);
    row.flip = ldr_flip(cold.image, reference_.image).mean;
    row.hdr_flip = hdr_flip(cold.image, reference_.image).mean;
    if (hybrid && c.ladder != Ladder::time) {
      const RenderResult warm = render_timed(row.options, "hybrid, warm", row.seconds_warm);
      if (warm.interrupted) return false;
      row.warm = warm.stats;
    }
    if (!hybrid && c.ladder == Ladder::samples && row.difference.rmse > 0.0) {
      least_error_ = least_error_ > 0.0 ? std::min(least_error_, row.difference.rmse) : row.difference.rmse;
    }
    if (hybrid && c.options.target_error > 0.0f && c.options.target_error == error_of(middle_target())) {
      equal_seconds_ = row.seconds_cold;
    }
    if (callbacks_.row) callbacks_.row(row, cold.image);
    return true;
  }

  float error_of(double target) const { return rounded(target * least_error_); }

  bool measure_targets(Method method) {
    if (!(least_error_ > 0.0)) return true;
    for (const double target : plan_.targets) {
      TradeoffCase c = {plan_.target_options, Ladder::target};
      c.options.method = method;
      c.options.target_error = error_of(target);
      if (!measure(c)) return false;
    }
    return true;
  }

  bool measure_equal_time() {
    if (!plan_.equal_time || !(equal_seconds_ > 0.0)) return true;
    for (const Method method : {Method::monte_carlo, Method::hybrid}) {
      TradeoffCase c = {plan_.target_options, Ladder::time};
      c.options.method = method;
      c.options.time_limit = float(equal_seconds_);
      if (!measure(c)) return false;
    }
    return true;
  }

  bool measure_parts() {
    if (plan_.seeds < 2 || reference_.halves[0].data.empty()) return true;
    for (const RenderOptions& options : plan_.parts) {
      const ScratchFolder cache(scratch_folder_, "field-cache");
      TradeoffParts parts{options, plan_.seeds, {}};
      std::vector<Image> pictures;
      for (int k = 0; k < plan_.seeds; ++k) {
        RenderOptions o = options;
        // Seeds of the reference's halves are left out.
        if (k > 0) o.seed = plan_.reference.seed.value_or(scene_.seed) + 1u + uint32_t(k);
        o.field_cache = is_hybrid(o) ? cache.path() : std::string();
        double seconds = 0;
        RenderResult result = render_timed(o, "bias and variance", seconds);
        if (result.interrupted) return false;
        pictures.push_back(std::move(result.image));
      }
      parts.parts = split_error(pictures, reference_.halves[0], reference_.halves[1]);
      if (callbacks_.parts) callbacks_.parts(parts);
    }
    return true;
  }

  const Scene& scene_;
  const TradeoffPlan& plan_;
  const std::string& scratch_folder_;
  TradeoffReference& reference_;
  const TradeoffCallbacks& callbacks_;
  double total_ = 0, done_ = 0;
  double most_samples_ = 1;   // of Monte Carlo's cases
  double least_error_ = 0;    // of these
  double equal_seconds_ = 0;  // of the pictures in equal time; 0: unknown yet
};

}  // namespace

TradeoffPlan make_tradeoff_plan(const Scene& scene, const TradeoffPlanOptions& options) {
  TradeoffPlan plan;
  const uint32_t seed = options.base.seed.value_or(scene.seed);
  plan.reference = options.base;
  plan.reference.method = Method::monte_carlo;
  plan.reference.spp = options.quick ? 256 : 4096;
  plan.reference.seed = seed + 1;

  const auto with = [&](Method method, int spp, std::optional<float> tolerance, int directions, int plane) {
    RenderOptions o = options.base;
    o.method = method;
    // Monte Carlo at its best; the reference is not.
    if (method == Method::monte_carlo && o.light_estimator == LightEstimator::automatic)
      o.light_estimator = LightEstimator::adaptive;
    o.spp = spp;
    o.tolerance = tolerance;
    o.directions = directions;
    o.plane = plane;
    o.seed = seed;
    return o;
  };
  const int scene_directions = options.base.directions, scene_plane = options.base.plane;
  const float tolerance = options.base.base_tolerance();
  const std::vector<int> monte_carlo = options.quick ? std::vector{1, 4, 16} : std::vector{1, 4, 16, 64, 256};
  const std::vector<int> hybrid = options.quick ? std::vector{1, 4, 16} : std::vector{1, 4, 16, 64};
  const std::vector<float> tolerances =
      options.quick ? std::vector{0.0f, 0.1f, 1.0f} : std::vector{0.0f, 0.05f, 0.1f, 0.25f, 0.5f, 1.0f};
  for (const int spp : monte_carlo) plan.cases.push_back({with(Method::monte_carlo, spp, tolerance, 0, 0)});
  for (const int spp : hybrid) {
    for (const float t : tolerances) {
      plan.cases.push_back({with(Method::hybrid, spp, t, scene_directions, scene_plane)});
    }
  }
  using Resolution = std::pair<int, int>;
  std::vector<Resolution> resolutions = {{32, 64}, {64, 128}};
  if (!options.quick) {
    resolutions.clear();
    for (const int directions : {32, 64, 128}) {
      for (const int plane : {64, 128, 256}) resolutions.push_back({directions, plane});
    }
  }
  for (const auto& [directions, plane] : resolutions) {
    plan.cases.push_back(
        {with(Method::hybrid, options.quick ? 4 : 16, tolerance, directions, plane), Ladder::resolution});
  }

  plan.targets = options.quick ? std::vector{2.0, 1.0, 0.5} : std::vector{8.0, 4.0, 2.0};
  plan.target_options = with(Method::hybrid, 0, options.base.tolerance, scene_directions, scene_plane);
  plan.equal_time = true;

  plan.seeds = options.quick ? 3 : 4;
  const int spp = options.quick ? 16 : 64;
  plan.parts.push_back(with(Method::monte_carlo, spp, tolerance, 0, 0));
  for (const float t : options.quick ? std::vector{tolerance, 1.0f} : std::vector{tolerance, 0.5f, 1.0f}) {
    plan.parts.push_back(with(Method::hybrid, spp, t, scene_directions, scene_plane));
  }
  return plan;
}

bool run_tradeoff(const Scene& scene, const TradeoffPlan& plan, const std::string& scratch_folder,
                  TradeoffReference& reference, const TradeoffCallbacks& callbacks) {
  return TradeoffRun(scene, plan, scratch_folder, reference, callbacks).run();
}

std::vector<ErrorPoint> monte_carlo_points(const std::vector<TradeoffRow>& rows, Ladder ladder) {
  const Ladder wanted = ladder == Ladder::target ? Ladder::target : Ladder::samples;
  std::vector<ErrorPoint> points;
  for (const TradeoffRow& row : rows) {
    if (!is_hybrid(row.options) && row.ladder == wanted) points.push_back({row.seconds_cold, row.difference.rmse});
  }
  return points;
}

FramesToPay frames_to_pay(double seconds_cold, double seconds_warm, const TimeAtError& monte_carlo) {
  using Relation = FramesToPay::Relation;
  const double gain = monte_carlo.seconds - seconds_warm, bake = seconds_cold - seconds_warm;
  if (!std::isfinite(gain + bake)) return {};
  const bool more = monte_carlo.relation == TimeAtError::Relation::more_than;
  const bool less = monte_carlo.relation == TimeAtError::Relation::less_than;
  if (gain <= 0.0) return {more ? Relation::unknown : Relation::never, 0.0};
  const double frames = std::max(1.0, std::floor(bake / gain) + 1.0);
  return {more ? Relation::at_most : less ? Relation::at_least : Relation::equals, frames};
}

std::string tradeoff_csv_header() {
  return "method,spp,light_samples,tolerance,directions,plane,ladder,target_error,error_estimate,time_limit,"
         "seconds_cold,seconds_warm,seconds_bake,seconds_primary,seconds_secondary_cold,seconds_secondary_warm,rmse,"
         "relmse,worst_block_rmse,bias,flip,hdr_flip,exact_fraction,spheres_per_ray,bytes_memory,bytes_disk,"
         "frames_relation,frames_to_pay,montecarlo_relation,montecarlo_seconds";
}

std::string tradeoff_csv_row(const TradeoffRow& row, const std::vector<ErrorPoint>& monte_carlo) {
  const Stats &c = row.cold, &w = row.warm;
  const ImageDifference& d = row.difference;
  const RenderOptions& o = row.options;
  constexpr const char* k_ladders[] = {"samples", "resolution", "target", "time"};
  const TimeAtError time = seconds_at_error(monte_carlo, d.rmse);
  const auto unless_0 = [](double v) { return v > 0.0 && std::isfinite(v) ? fmt::format("{:.6g}", v) : std::string(); };
  return fmt::format(
      "{},{},{},{:.6g},{},{},{},{},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},"
      "{:.6g},{:.6g},{:.6g},{},{},{},{}",
      is_hybrid(o) ? "hybrid" : "montecarlo", c.spp, c.light_samples, o.tolerance.value_or(c.tolerance),
      c.field_directions, c.field_plane, k_ladders[int(row.ladder)], unless_0(o.target_error),
      o.by_rounds() ? unless_0(c.error_estimate) : "", unless_0(o.time_limit), row.seconds_cold, row.seconds_warm,
      c.time_bake, c.time_primary, c.time_secondary, w.time_secondary, d.rmse, d.relmse, d.worst_block_rmse, d.bias,
      row.flip, row.hdr_flip, c.exact_fraction(), c.spheres_per_ray(), c.field_bytes_memory, c.field_bytes_disk,
      has_bake(row) ? frames_columns(frames_to_pay(row.seconds_cold, row.seconds_warm, time)) : ",",
      time_columns(time));
}

std::string parts_csv_header() {
  return "method,spp,light_samples,tolerance,seeds,mse,bias_square,bias_square_error,variance,reference_variance";
}

std::string parts_csv_row(const TradeoffParts& p) {
  const RenderOptions& o = p.options;
  // Of a single block no error is known.
  const double error = p.parts.bias_square_error;
  return fmt::format("{},{},{},{:.6g},{},{:.6g},{:.6g},{},{:.6g},{:.6g}", is_hybrid(o) ? "hybrid" : "montecarlo", o.spp,
                     o.light_samples, o.base_tolerance(), p.seeds, p.parts.mean_square, p.parts.bias_square,
                     std::isnan(error) ? std::string() : fmt::format("{:.6g}", error), p.parts.variance,
                     p.parts.reference_variance);
}

TimeAtError seconds_at_error(std::vector<ErrorPoint> points, double rmse) {
  using Relation = TimeAtError::Relation;
  const auto usable = [](double v) { return std::isfinite(v) && v > 0.0; };
  std::erase_if(points, [&](const ErrorPoint& p) { return !usable(p.seconds) || !usable(p.rmse); });
  if (points.empty() || !usable(rmse)) return {std::nan(""), Relation::equals};
  std::sort(points.begin(), points.end(), [](const ErrorPoint& a, const ErrorPoint& b) { return a.rmse > b.rmse; });
  if (rmse > points.front().rmse) return {points.front().seconds, Relation::less_than};
  if (rmse < points.back().rmse) return {points.back().seconds, Relation::more_than};
  if (rmse == points.front().rmse) return {points.front().seconds, Relation::equals};
  size_t i = 1;
  while (points[i].rmse > rmse) ++i;
  const ErrorPoint &a = points[i - 1], &b = points[i];
  const double f = std::log(a.rmse / rmse) / std::log(a.rmse / b.rmse);
  return {a.seconds * std::pow(b.seconds / a.seconds, f), Relation::equals};
}

}  // namespace fieldtrace
