#include "field/thesis/thesis_field.h"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "field/thesis/chart_thesis.hd.h"

namespace fieldtrace {
namespace {

// Normal at a point of a triangle: interpolated from the mesh's normals, or else the triangle's own. Not normalised.
DVec3 normal_at(const TriangleMesh& mesh, uint32_t primitive, const DVec3& geometric, const DVec3& at) {
  if (mesh.normals.empty()) return geometric;
  const UVec3 t = mesh.triangles[primitive];
  const DVec3 p0(mesh.positions[t.x]), e1 = DVec3(mesh.positions[t.y]) - p0, e2 = DVec3(mesh.positions[t.z]) - p0;
  const DVec3 n = glm::cross(e1, e2), q = at - p0;
  const double area = glm::dot(n, n);
  if (!(area > 0.0)) return geometric;
  const double u = glm::dot(glm::cross(q, e2), n) / area, v = glm::dot(glm::cross(e1, q), n) / area;
  return DVec3(mesh.normals[t.x]) * (1.0 - u - v) + DVec3(mesh.normals[t.y]) * u + DVec3(mesh.normals[t.z]) * v;
}

// Symmetric objects have edges in the very planes that hold entry points, and a ray that meets an edge exactly may slip
// between its triangles (docs/decisions/002-embree-packets.md): one sample in 5,000 of a sphere did. So rays start
// beside their entry points by an irregular offset, in unit space, of less than a hundredth of the distance between
// these: 2^-12 is far above the rounding of positions and too small to be seen in a picture.
constexpr float k_nudge_x = 0.61803399f * 0x1p-12f, k_nudge_y = 0.27639320f * 0x1p-12f;

uint8_t encode_component(double x) {
  return uint8_t(std::lround(std::clamp(x, -1.0, 1.0) * k_thesis_normal_zero) + k_thesis_normal_zero);
}

// The direction cells' directions, v-major, in the frame of any position.
std::vector<scalar::Vec3Lanes<float>> inward_directions(int m) {
  std::vector<scalar::Vec3Lanes<float>> all;
  for (int v = 0; v < m; ++v) {
    for (int u = 0; u < m; ++u) all.push_back(scalar::thesis_inward<float>(u, v, make_axis(m)));
  }
  return all;
}

struct Workspace {
  RayBatch rays;
  ShapeHits hits;
};

struct BakeInput {
  const Accel& accel;
  const TriangleMesh& mesh;
  uint32_t shape;
  std::vector<scalar::Vec3Lanes<float>> inwards;
};

void bake_position(const BakeInput& input, uint32_t position, Workspace& work, ThesisField& field) {
  const Sphere& ball = field.ball();
  const size_t count = input.inwards.size();
  work.rays.resize(count);
  work.hits.resize(count);
  const auto at = scalar::thesis_position<float>(int32_t(position));
  const auto entry = at.point + at.frame.x * k_nudge_x + at.frame.y * k_nudge_y;
  const Vec3 origin = ball.centre + ball.radius * Vec3(entry.x, entry.y, entry.z);
  for (size_t i = 0; i < count; ++i) {
    const auto d = scalar::thesis_ray(at, input.inwards[i]).direction;
    // Directions of length R: t comes out in unit space.
    work.rays.set(i, origin, ball.radius * Vec3(d.x, d.y, d.z), k_infinity);
  }
  input.accel.shape_intersect(input.shape, work.rays, work.hits);
  uint8_t* distance = field.distances_of(position);
  for (size_t i = 0; i < count; ++i) {
    const float t = work.hits.t[i];
    if (!(t >= 0.0f)) continue;
    distance[i] = uint8_t(std::min(std::lround(double(t) * (0.5 * k_thesis_steps)), long(k_thesis_steps)));
    if (!field.has_normals()) continue;
    uint8_t* normal = field.normals_of(position) + 3 * i;
    const DVec3 geometric(work.hits.nx[i], work.hits.ny[i], work.hits.nz[i]), d(work.rays.direction(i));
    const DVec3 hit = DVec3(origin) + d * double(t);
    DVec3 n = glm::normalize(normal_at(input.mesh, work.hits.primitive[i], geometric, hit));
    if ((glm::dot(geometric, d) > 0.0) == (glm::dot(geometric, n) > 0.0)) n = -n;
    for (int axis = 0; axis < 3; ++axis) normal[axis] = encode_component(n[axis]);
  }
}

}  // namespace

bool valid_thesis_parameters(const FieldParameters& p) {
  return (p.directions == 32 || p.directions == 64 || p.directions == 128) && p.plane == 0 && p.lines == 0;
}

ThesisField::ThesisField(const Sphere& ball, int m, ThesisLayers layers) : ball_(ball), m_(m), layers_(layers) {
  distance_.assign(samples() + k_field_padding, uint8_t(k_thesis_miss));
  if (!has_normals()) return;
  normal_.assign(3 * samples() + k_field_padding, uint8_t(k_thesis_normal_zero));
}

size_t thesis_samples(int m) { return size_t(scalar::k_thesis_positions) * size_t(m) * size_t(m); }

ThesisFieldView ThesisField::view() const {
  ThesisFieldView view;
  view.directions = make_axis(m_);
  view.m = m_;
  view.distance = distance_.data();
  view.normal = has_normals() ? normal_.data() : nullptr;
  return view;
}

Sphere thesis_ball(const TriangleMesh& mesh) {
  Sphere ball;
  ball.centre = mesh.bounds().centre();
  for (const Vec3& p : mesh.positions) ball.radius = std::max(ball.radius, glm::length(p - ball.centre));
  // Rounding of the distance, and of the entry points: centre + radius * point, a few operations each.
  ball.radius *= 1.0f + gamma_bound(32);
  return ball;
}

std::optional<ThesisField> bake_thesis_field(const Accel& accel, const Scene& scene, uint32_t shape, int m,
                                             const ThesisBakeCallbacks& callbacks, ThesisLayers layers) {
  ThesisField field(thesis_ball(scene.shapes[shape].mesh), m, layers);
  const BakeInput input = {accel, scene.shapes[shape].mesh, shape, inward_directions(m)};
  constexpr uint32_t k_per_task = 32;
  const uint32_t tasks = (uint32_t(scalar::k_thesis_positions) + k_per_task - 1) / k_per_task;
  std::mutex mutex;
  uint32_t done = 0;
  parallel_for(tasks, [&](size_t task) {
    if (callbacks.stop && *callbacks.stop) return;
    const auto start = std::chrono::steady_clock::now();
    Workspace work;
    const uint32_t begin = uint32_t(task) * k_per_task;
    const uint32_t end = std::min(begin + k_per_task, uint32_t(scalar::k_thesis_positions));
    for (uint32_t position = begin; position < end; ++position) bake_position(input, position, work, field);
    const double seconds = seconds_since(start);
    const std::lock_guard lock(mutex);
    if (callbacks.counters) {
      callbacks.counters->rays += uint64_t(end - begin) * input.inwards.size();
      callbacks.counters->seconds += seconds;
    }
    ++done;
    if (callbacks.progress) callbacks.progress(float(done) / float(tasks));
  });
  if (callbacks.stop && *callbacks.stop) return std::nullopt;
  return field;
}

float thesis_slack(int m) {
  constexpr float k_entry_radius = 0.0427f, k_half_diagonal = 1.41421356f, k_half_step = 1.0f / float(k_thesis_steps);
  constexpr float k_least_slope = 0.5f;
  return (k_entry_radius + k_half_diagonal / float(m)) / k_least_slope + k_half_step;
}

ThesisInstanceView thesis_instance_view(const ThesisField& field, const Instance& instance, uint32_t index) {
  ThesisInstanceView view;
  view.field = field.view();
  view.slack = thesis_slack(field.m());
  view.instance = index;
  write_unit_transform(instance.to_object, field.ball(), view.to_unit);
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) view.to_normal[3 * column + row] = instance.to_object[row][column];
  }
  return view;
}

}  // namespace fieldtrace
