// make_lights: converts the scene's emitters to lights in world space. All geometry is computed in double.

#include <algorithm>
#include <string>

#include "core/light/light_sampling.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

constexpr double k_double_pi = 3.14159265358979323846;

// Tolerance for orthogonal or equally long columns: the rounding of a transform composed of float rotations and scales,
// a dozen products and sums of unit columns.
constexpr double k_similarity_tolerance = gamma_bound(16);

// Roundings between the ray that sample_light returns and the tracer's decision whether it hits the light: origin and
// direction into object space (4 each), the intersection there (8). Each is relative to a coordinate of the origin or
// of the light, carried through the transform and its inverse.
constexpr double k_tracer_error = gamma_bound(16);

void set(float (&out)[3], const DVec3& v) {
  for (int i = 0; i < 3; ++i) out[i] = float(v[i]);
}

double sum_of_magnitudes(const DVec3& v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

struct Placement {
  DAffine to_world;
  DMat3 linear, inverse_transpose;
  DVec3 origin;
  double determinant, sign;  // sign: -1 for flipped normals

  explicit Placement(const Instance& instance)
      : to_world(instance.to_world),
        linear(to_world[0], to_world[1], to_world[2]),
        inverse_transpose(glm::transpose(glm::inverse(linear))),
        origin(to_world[3]),
        determinant(glm::determinant(linear)),
        sign(instance.flip_normals ? -1.0 : 1.0) {}

  bool orthogonal(int i, int j) const {
    return std::abs(glm::dot(linear[i], linear[j])) <=
           k_similarity_tolerance * glm::length(linear[i]) * glm::length(linear[j]);
  }
  bool similarity() const {
    const double a = glm::length(linear[0]), b = glm::length(linear[1]), c = glm::length(linear[2]);
    return orthogonal(0, 1) && orthogonal(1, 2) && orthogonal(0, 2) && std::abs(a - b) <= k_similarity_tolerance * a &&
           std::abs(a - c) <= k_similarity_tolerance * a;
  }
  // Largest row sum of |L| |L^-1|: how much an error of a world coordinate grows on the way to object space and back.
  double condition() const {
    double largest = 1.0;
    for (int row = 0; row < 3; ++row) {
      double sum = 0.0;
      for (int k = 0; k < 3; ++k) sum += std::abs(linear[k][row]) * sum_of_magnitudes(inverse_transpose[k]);
      largest = std::max(largest, sum);
    }
    return largest;
  }
};

// `reach`: sum of the magnitudes of the largest world coordinates of the light and of its transform's translation.
void set_error(Light& light, double condition, double reach) {
  light.error_slope = float(k_tracer_error * condition);
  light.error_base = std::max(float(k_tracer_error * condition * reach), std::numeric_limits<float>::min());
}

void set_affine(Light& light, const Placement& p, double unit_area) {
  DVec3 reach = glm::abs(p.origin);
  set(light.centre, p.origin);
  for (int i = 0; i < 3; ++i) {
    set(light.axis[i], p.linear[i]);
    set(light.normal_axis[i], p.inverse_transpose[i] * p.sign);
    reach += glm::abs(p.linear[i]);
  }
  set(light.normal, glm::normalize(p.inverse_transpose[2]) * p.sign);
  light.emission_sign = float(p.sign);
  light.area = float(std::abs(p.determinant) * unit_area);
  set_error(light, p.condition(), sum_of_magnitudes(reach));
}

void set_mesh(LightTable& table, Light& light, const Shape& shape, const Placement& p) {
  const TriangleMesh& mesh = shape.mesh;
  // Cross products of world-space edges point along the transformed object-space normal, or against it if mirrored.
  const double orientation = p.determinant < 0 ? -p.sign : p.sign;
  constexpr size_t k_most_triangles = size_t(1) << 26;  // 32-bit places in their table
  if (mesh.triangles.size() > k_most_triangles)
    throw Error({shape.name}, "a mesh of more than 2^26 triangles cannot glow; use a coarser one as the light");
  std::vector<double> cumulative(mesh.triangles.size() + 1, 0.0);
  DVec3 reach(0.0);
  const auto corner = [&](uint32_t vertex) { return p.linear * DVec3(mesh.positions[vertex]) + p.origin; };
  light.first_triangle = uint32_t(table.triangles.size());
  light.triangle_count = uint32_t(mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const UVec3& t = mesh.triangles[i];
    const DVec3 a = corner(t.x), b = corner(t.y), c = corner(t.z);
    const DVec3 cross = glm::cross(b - a, c - a);
    const double length = glm::length(cross);
    cumulative[i + 1] = cumulative[i] + 0.5 * length;
    reach = glm::max(reach, glm::max(glm::abs(a), glm::max(glm::abs(b), glm::abs(c))));
    LightTriangle out = {};
    set(out.p0, a), set(out.edge1, b - a), set(out.edge2, c - a);
    set(out.normal, length > 0 ? cross * (orientation / length) : DVec3(0.0, 0.0, 1.0));
    table.triangles.push_back(out);
  }
  const double area = cumulative.back();
  light.area = float(area);
  if (!(area > 0)) return;
  // The samples' third number is a multiple of 2^-24; rounding the cumulative sums to such multiples makes the
  // probabilities exact. Triangles with a smaller share may get probability 0: they are then not sampled, and their
  // density is 0.
  const auto rounded = [&](size_t i) { return std::round(cumulative[i] / area * 0x1p24) * 0x1p-24; };
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    LightTriangle& t = table.triangles[light.first_triangle + i];
    const double probability = rounded(i + 1) - rounded(i);
    t.cdf = float(rounded(i));
    t.inverse_density = probability > 0 ? float((cumulative[i + 1] - cumulative[i]) / probability) : 0.0f;
  }
  set_error(light, p.condition(), sum_of_magnitudes(reach) + sum_of_magnitudes(p.origin));
}

void set_area_light(LightTable& table, Light& light, const Scene& scene, uint32_t instance_index) {
  const Instance& instance = scene.instances[instance_index];
  const Shape& shape = scene.shapes[instance.shape];
  const Placement p(instance);
  const double plane_area = glm::length(glm::cross(p.linear[0], p.linear[1]));
  light.instance = instance_index;
  switch (shape.kind) {
    case ShapeKind::sphere:
      set_affine(light, p, 4.0 * k_double_pi);
      light.kind = LightKind::ellipsoid;
      if (p.similarity()) {
        light.kind = instance.flip_normals ? LightKind::sphere_inside : LightKind::sphere;
        light.radius = float(std::cbrt(std::abs(p.determinant)));
      }
      break;
    case ShapeKind::cylinder:
      set_affine(light, p, 2.0 * k_double_pi);
      light.kind = LightKind::cylinder;
      break;
    case ShapeKind::disk:
      set_affine(light, p, 1.0);
      light.kind = LightKind::disk;
      light.area = float(plane_area * k_double_pi);
      break;
    case ShapeKind::rectangle:
      set_affine(light, p, 1.0);
      light.kind = p.orthogonal(0, 1) ? LightKind::rectangle : LightKind::parallelogram;
      light.area = float(plane_area * 4.0);
      for (int i = 0; i < 2; ++i) {
        set(light.unit_axis[i], glm::normalize(p.linear[i]));
        light.half_size[i] = float(glm::length(p.linear[i]));
      }
      break;
    case ShapeKind::mesh:
      light.kind = LightKind::mesh;
      light.emission_sign = float(p.sign);
      set_mesh(table, light, shape, p);
      break;
  }
  if (!(light.area > 0)) light.kind = LightKind::none;
}

void set_environment(LightTable& table, Light& light, const Scene& scene, const Emitter& emitter) {
  if (!table.environment.rows.empty()) throw Error("the scene has two environment maps; remove one");
  if (emitter.bitmap >= scene.bitmaps.size()) throw Error("the environment map has no image");
  light.kind = LightKind::environment;
  make_environment(scene.bitmaps[emitter.bitmap], emitter.rotation, table.environment, light);
}

}  // namespace

LightTable make_lights(const Scene& scene) {
  LightTable table;
  table.point_sets = make_point_sets();
  table.lights.resize(scene.emitters.size());
  for (size_t i = 0; i < scene.emitters.size(); ++i) {
    const Emitter& emitter = scene.emitters[i];
    Light& light = table.lights[i];
    set(light.value, DVec3(emitter.value));
    switch (emitter.kind) {
      case EmitterKind::area:
        if (emitter.instance >= scene.instances.size()) {
          throw Error("area light " + std::to_string(i) + " belongs to no shape; put the emitter inside a shape");
        }
        set_area_light(table, light, scene, emitter.instance);
        break;
      case EmitterKind::constant:
        light.kind = LightKind::constant;
        break;
      case EmitterKind::environment:
        set_environment(table, light, scene, emitter);
        break;
      case EmitterKind::point:
        light.kind = LightKind::point;
        set(light.centre, DVec3(emitter.position));
        set_error(light, 1.0, sum_of_magnitudes(DVec3(emitter.position)));
        break;
      case EmitterKind::directional:
        light.kind = LightKind::directional;
        set(light.centre, -glm::normalize(DVec3(emitter.direction)));
        break;
    }
    if (std::all_of(light.value, light.value + 3, [](float v) { return v == 0.0f; })) light.kind = LightKind::none;
  }
  return table;
}

}  // namespace fieldtrace
