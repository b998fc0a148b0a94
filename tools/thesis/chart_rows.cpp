#include "tools/thesis/chart_rows.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>

#include "field/bake/bake_full.h"
#include "field/store/risk_classes.h"
#include "field/thesis/thesis_kernels.h"

namespace fieldtrace {
namespace {

constexpr int k_light_rays = 64;       // per shading point
constexpr size_t k_batch_rays = 8192;  // as in the renderer: one batch stays in the second-level cache
constexpr float k_light_distance = 4.6f, k_light_radius = 0.3f;  // in R, from the object's centre: about 7 degrees
constexpr int k_most_rounds = 6;                                 // of baking: hybrid/visibility/shadow_workspace.h

enum class ShadingPoints { behind, on_object };

// The rays of the comparison: k_light_rays per shading point.
struct Workload {
  RayBatch rays;
  AlignedVector<uint32_t> instances;  // of the shading points
  std::vector<uint8_t> blocked;       // by Embree
};

class Points {
 public:
  explicit Points(uint32_t seed) : engine_(seed) {}
  float uniform() { return float(engine_() >> 8) * 0x1p-24f; }
  Vec3 in_ball() {
    for (;;) {
      const Vec3 p = 2.0f * Vec3(uniform(), uniform(), uniform()) - 1.0f;
      if (glm::dot(p, p) < 1.0f) return p;
    }
  }

 private:
  std::mt19937 engine_;
};

Workload make_workload(const TriangleMesh& mesh, const Sphere& ball, const Accel& accel, ShadingPoints where,
                       size_t shading_points) {
  const Vec3 to_light = glm::normalize(Vec3(0.4f, -0.6f, 0.7f));
  const Vec3 across = glm::normalize(glm::cross(to_light, Vec3(0.0f, 0.0f, 1.0f))), up = glm::cross(across, to_light);
  Points points(1);
  Workload workload;
  workload.rays.resize(shading_points * k_light_rays);
  workload.instances.assign(padded(workload.rays.size), where == ShadingPoints::on_object ? 0u : 1u);
  for (size_t r = 0; r < shading_points;) {
    Vec3 p;
    if (where == ShadingPoints::behind) {
      const float x = 2.0f * points.uniform() - 1.0f, y = 2.0f * points.uniform() - 1.0f;
      p = ball.centre + ball.radius * (1.2f * (x * across + y * up) - 2.0f * to_light);
    } else {
      const UVec3 t = mesh.triangles[size_t(points.uniform() * float(mesh.triangles.size()))];
      const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
      const Vec3 n = glm::cross(b - a, c - a);
      if (!(glm::dot(n, to_light) > 0.0f)) continue;
      // Far enough that no ray hits the triangle it starts on, and negligible: a thousandth of a depth step.
      p = (a + b + c) / 3.0f + glm::normalize(n) * (1e-5f * ball.radius);
    }
    for (int k = 0; k < k_light_rays; ++k) {
      const Vec3 at = ball.centre + ball.radius * (k_light_distance * to_light + k_light_radius * points.in_ball());
      workload.rays.set(r * k_light_rays + size_t(k), p, at - p, 1.0f);
    }
    ++r;
  }
  std::vector<uint32_t> all(workload.rays.size);
  std::iota(all.begin(), all.end(), 0u);
  workload.blocked.assign(padded(workload.rays.size), 0);
  accel.occluded(workload.rays, all, workload.blocked.data());
  return workload;
}

// RMSE of the shading points' visibility. `states` is the field's result; undecided rays are taken from Embree, without
// error.
void count_errors(const Workload& workload, const RayStates& states, ThesisChartRow& row) {
  double sum = 0.0;
  size_t undecided = 0, crossing = 0;
  const size_t shading_points = workload.rays.size / k_light_rays;
  for (size_t r = 0; r < shading_points; ++r) {
    int difference = 0;
    for (size_t i = r * k_light_rays; i < (r + 1) * k_light_rays; ++i) {
      const int32_t s = states.state[i];
      const bool hides = (s & RayStates::k_blocked) != 0, is_undecided = s >= RayStates::k_undecided;
      crossing += (s & RayStates::k_crosses) != 0;
      undecided += is_undecided;
      if (!is_undecided) difference += int(hides) - int(workload.blocked[i]);
    }
    sum += double(difference) * difference;
  }
  row.rmse = std::sqrt(sum / double(shading_points)) / k_light_rays;
  row.exact_share = crossing ? double(undecided) / double(crossing) : 0.0;
}

// This thread's processor time, which other work on the machine disturbs less than wall time.
double thread_nanoseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e9 * double(t.tv_sec) + double(t.tv_nsec);
}

// Least time of `repeats` runs over all batches. query(begin, end) returns its counts.
template <class Query>
void time_look_ups(const Workload& workload, int repeats, ThesisChartRow& row, RayStates& states, const Query& query) {
  double least = 0.0;
  SegmentCounts counts;
  for (int k = 0; k <= repeats; ++k) {
    states.reset(workload.rays.size);
    counts = {};
    const double start = thread_nanoseconds();
    for (size_t begin = 0; begin < workload.rays.size; begin += k_batch_rays) {
      const SegmentCounts c = query(begin, std::min(begin + k_batch_rays, padded(workload.rays.size)));
      counts.crossings += c.crossings;
      counts.lookups += c.lookups;
    }
    const double ns = thread_nanoseconds() - start;
    if (k == 1 || ns < least) least = ns;  // the first run warms up
  }
  row.look_ups_per_ray = double(counts.lookups) / double(std::max<uint64_t>(counts.crossings, 1));
  row.ns_per_look_up = least / double(std::max<uint64_t>(counts.lookups, 1));
}

uint64_t complete_bytes(const FieldParameters& p, ShadingPoints where) {
  const auto bytes = [&](FieldLayer layer) {
    return reachable_cells(p, layer) * (Field::brick_bytes(layer) / uint64_t(scalar::k_brick_cells));
  };
  return bytes(FieldLayer::visibility) + (where == ShadingPoints::on_object ? bytes(FieldLayer::depth) : 0);
}

// The finest resolution with N = D or N = 2 D (the default) that takes no more than `limit` bytes.
std::optional<FieldParameters> finest_within(uint64_t limit, ShadingPoints where) {
  std::optional<FieldParameters> finest;
  for (const int directions : {32, 64, 128, 256}) {
    for (const int plane : {directions, 2 * directions}) {
      const FieldParameters p = {.directions = directions, .plane = plane};
      if (valid_parameters(p) && complete_bytes(p, where) <= limit) finest = p;
    }
  }
  return finest;
}

class Comparison {
 public:
  Comparison(const Scene& scene, const Accel& accel, const ThesisRunOptions& options)
      : scene_(scene), accel_(accel), options_(options) {}

  ThesisChartRow by_thesis(const ThesisField& field, const Workload& workload) const {
    ThesisChartRow row;
    row.chart = fmt::format("thesis, M = {}", field.m());
    row.bytes = field.bytes_distance();
    const ThesisInstanceView view = thesis_instance_view(field, scene_.instances[0], 0);
    const ThesisKernels& kernels = thesis_kernels(resolve_isa(options_.isa));
    RayStates states;
    time_look_ups(workload, options_.repeats(), row, states,
                  [&](size_t begin, size_t end) { return kernels.shadow(view, workload.rays, begin, end, 0, states); });
    count_errors(workload, states, row);
    return row;
  }

  ThesisChartRow by_orthographic(Field& field, const Workload& workload, float tolerance) const {
    ThesisChartRow row;
    const FieldParameters& p = field.parameters();
    row.chart = fmt::format("orthographic, {} x {}", p.directions, p.plane);
    row.tolerance = tolerance;
    SegmentTask task;
    task.field = field.view();
    task.policy = query_policy(tolerance);
    const double scale = 1.0 / double(field.ball().radius);
    for (int e = 0; e < 12; ++e) task.to_unit[e] = e % 4 == 0 && e < 9 ? float(scale) : 0.0f;
    for (int axis = 0; axis < 3; ++axis) task.to_unit[9 + axis] = float(-double(field.ball().centre[axis]) * scale);
    const SegmentKernels& kernels = segment_kernels(resolve_isa(options_.isa));
    RayStates states;
    const auto query = [&](size_t begin, size_t end) {
      return kernels.query(task, workload.rays, workload.instances.data(), begin, end, 0, states);
    };
    bake(field, workload, states, query);
    time_look_ups(workload, options_.repeats(), row, states, query);
    count_errors(workload, states, row);
    return row;
  }

 private:
  template <class Query>
  void bake(Field& field, const Workload& workload, RayStates& states, const Query& query) const {
    for (int round = 0; round < k_most_rounds; ++round) {
      states.reset(workload.rays.size);
      query(0, padded(workload.rays.size));
      if (states.unknown_blocks.empty()) return;
      BakeCounters counters;
      for (auto* list : {&states.unknown_visibility, &states.unknown_depth}) {
        std::sort(list->begin(), list->end());
        list->erase(std::unique(list->begin(), list->end()), list->end());
      }
      bake_slices(field, FieldLayer::visibility, states.unknown_visibility, accel_, 0, counters);
      bake_slices(field, FieldLayer::depth, states.unknown_depth, accel_, 0, counters);
      states.unknown_blocks.clear();
      states.unknown_visibility.clear();
      states.unknown_depth.clear();
    }
  }

  const Scene& scene_;
  const Accel& accel_;
  const ThesisRunOptions& options_;
};

}  // namespace

void compare_charts(const std::string& title, const Scene& scene, const Accel& accel, const ThesisField& field,
                    const ThesisRunOptions& options, std::vector<ThesisChartRow>& rows) {
  const Comparison comparison(scene, accel, options);
  const Shape& shape = scene.shapes[0];
  for (const ShadingPoints where : {ShadingPoints::behind, ShadingPoints::on_object}) {
    const Workload workload = make_workload(shape.mesh, field.ball(), accel, where, options.quick ? 64 : 1024);
    const auto add = [&](ThesisChartRow row) {
      row.object = title;
      row.shading_points = where == ShadingPoints::behind ? "behind" : "on the object";
      rows.push_back(std::move(row));
    };
    add(comparison.by_thesis(field, workload));
    const std::optional<FieldParameters> p = finest_within(field.bytes_distance(), where);
    if (!p) continue;
    Field orthographic(field_ball(shape.bounds), *p);
    for (const float tolerance : {0.1f, 1.0f}) {
      ThesisChartRow row = comparison.by_orthographic(orthographic, workload, tolerance);
      row.bytes = complete_bytes(*p, where);
      add(std::move(row));
    }
  }
}

}  // namespace fieldtrace
