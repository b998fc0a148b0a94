#include "hybrid/compare/tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/io/scratch_folder.h"

namespace fieldtrace {

namespace {

// Camera samples a pixel of one render: the measure of its share in the whole plan.
double work_of(const Scene& scene, const RenderOptions& options) {
  return options.spp > 0 ? options.spp : scene.sample_count;
}

bool is_hybrid(const RenderOptions& options) { return options.method == Method::hybrid; }

std::string time_columns(const TimeAtError& time) {
  if (!std::isfinite(time.seconds)) return ",";
  constexpr const char* k_relations[] = {"equals", "more_than", "less_than"};
  return fmt::format("{},{:.6g}", k_relations[int(time.relation)], time.seconds);
}

// Maps the progress of one render to that of the whole plan.
class PlanProgress {
 public:
  PlanProgress(const Scene& scene, const TradeoffPlan& plan, bool with_reference, const RenderCallbacks& callbacks)
      : scene_(scene), callbacks_(callbacks) {
    if (with_reference) total_ += work_of(scene, plan.reference);
    for (const RenderOptions& c : plan.cases) total_ += work_of(scene, c) * (is_hybrid(c) ? 2 : 1);
  }

  // Renders and times one case, then advances the progress by its whole work.
  RenderResult render_timed(const RenderOptions& options, const char* label, double& seconds) {
    const double work = work_of(scene_, options);
    RenderCallbacks callbacks = callbacks_;
    callbacks.progress = [&](float share, const char*) {
      if (callbacks_.progress) callbacks_.progress(float((done_ + share * work) / total_), label);
    };
    const auto start = std::chrono::steady_clock::now();
    RenderResult result = render(scene_, options, callbacks);
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    done_ += work;
    return result;
  }

 private:
  const Scene& scene_;
  const RenderCallbacks& callbacks_;
  double total_ = 0, done_ = 0;
};

}  // namespace

TradeoffPlan make_tradeoff_plan(const Scene& scene, const TradeoffPlanOptions& options) {
  TradeoffPlan plan;
  const uint32_t seed = options.base.seed.value_or(scene.seed);
  plan.reference = options.base;
  plan.reference.method = Method::monte_carlo;
  plan.reference.spp = options.quick ? 256 : 4096;
  plan.reference.seed = seed + 1;

  const auto add = [&](Method method, int spp, float tolerance, int directions, int plane) {
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
    plan.cases.push_back(o);
  };
  const int scene_directions = options.base.directions, scene_plane = options.base.plane;
  const std::vector<int> monte_carlo = options.quick ? std::vector{1, 4, 16} : std::vector{1, 4, 16, 64, 256};
  const std::vector<int> hybrid = options.quick ? std::vector{1, 4, 16} : std::vector{1, 4, 16, 64};
  const std::vector<float> tolerances =
      options.quick ? std::vector{0.0f, 0.1f, 1.0f} : std::vector{0.0f, 0.05f, 0.1f, 0.25f, 0.5f, 1.0f};
  for (const int spp : monte_carlo) add(Method::monte_carlo, spp, options.base.base_tolerance(), 0, 0);
  for (const int spp : hybrid) {
    for (const float tolerance : tolerances) add(Method::hybrid, spp, tolerance, scene_directions, scene_plane);
  }
  if (!options.quick) {
    for (const int directions : {32, 64, 128}) {
      for (const int plane : {64, 128, 256}) add(Method::hybrid, 16, options.base.base_tolerance(), directions, plane);
    }
  }
  return plan;
}

bool run_tradeoff(const Scene& scene, const TradeoffPlan& plan, const std::string& scratch_folder, Image& reference,
                  const TradeoffCallbacks& callbacks) {
  const bool with_reference = reference.data.empty();
  PlanProgress progress(scene, plan, with_reference, callbacks.render);
  double seconds = 0;
  if (with_reference) {
    RenderResult result = progress.render_timed(plan.reference, "reference", seconds);
    if (result.interrupted) return false;
    reference = std::move(result.image);
    if (callbacks.reference) callbacks.reference(reference);
  }
  for (const RenderOptions& options : plan.cases) {
    const ScratchFolder cache(scratch_folder, "field-cache");
    TradeoffRow row;
    row.options = options;
    row.options.field_cache = is_hybrid(options) ? cache.path() : std::string();
    RenderResult cold =
        progress.render_timed(row.options, is_hybrid(options) ? "hybrid, cold" : "Monte Carlo", row.seconds_cold);
    if (cold.interrupted) return false;
    row.cold = row.warm = cold.stats;
    row.seconds_warm = row.seconds_cold;
    row.difference = compare_images(cold.image, reference);
    if (is_hybrid(options)) {
      const RenderResult warm = progress.render_timed(row.options, "hybrid, warm", row.seconds_warm);
      if (warm.interrupted) return false;
      row.warm = warm.stats;
    }
    if (callbacks.row) callbacks.row(row, cold.image);
  }
  return true;
}

std::vector<ErrorPoint> monte_carlo_points(const std::vector<TradeoffRow>& rows) {
  std::vector<ErrorPoint> points;
  for (const TradeoffRow& row : rows) {
    if (!is_hybrid(row.options)) points.push_back({row.seconds_cold, row.difference.rmse});
  }
  return points;
}

std::string tradeoff_csv_header() {
  return "method,spp,light_samples,tolerance,directions,plane,seconds_cold,seconds_warm,seconds_bake,"
         "seconds_primary,seconds_secondary_cold,seconds_secondary_warm,rmse,relmse,worst_block_rmse,bias,"
         "exact_fraction,spheres_per_ray,bytes_memory,bytes_disk,montecarlo_relation,montecarlo_seconds";
}

std::string tradeoff_csv_row(const TradeoffRow& row, const std::vector<ErrorPoint>& monte_carlo) {
  const Stats &c = row.cold, &w = row.warm;
  const ImageDifference& d = row.difference;
  return fmt::format(
      "{},{},{},{:.6g},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},"
      "{:.6g},{:.6g},{},{},{}",
      is_hybrid(row.options) ? "hybrid" : "montecarlo", c.spp, c.light_samples, row.options.base_tolerance(),
      c.field_directions, c.field_plane, row.seconds_cold, row.seconds_warm, c.time_bake, c.time_primary,
      c.time_secondary, w.time_secondary, d.rmse, d.relmse, d.worst_block_rmse, d.bias, c.exact_fraction(),
      c.spheres_per_ray(), c.field_bytes_memory, c.field_bytes_disk,
      time_columns(seconds_at_error(monte_carlo, d.rmse)));
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
