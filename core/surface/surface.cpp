#include "core/surface/surface.h"

#include <algorithm>
#include <cmath>

#include "core/surface/surface_batch-inl.h"

namespace fieldtrace {
namespace {

// Texture coordinates near a triangle are extrapolated by at most this many of its edges; beyond, slivers give no
// useful values.
constexpr double k_most_edges = 8.0;

using DVec3Lanes = scalar::Vec3Lanes<double>;
using LocalSurface = scalar::LocalSurface<double>;

DVec3Lanes lanes(const DVec3& v) { return {v.x, v.y, v.z}; }
DVec3 to_vec(const DVec3Lanes& v) { return {v.x, v.y, v.z}; }

// Azimuth as a fraction of a turn in [0, 1), like Mitsuba's uv on round shapes.
float turn_fraction(double y, double x) {
  const double turns = std::atan2(y, x) * (0.5 / 3.14159265358979323846);
  return float(turns < 0.0 ? turns + 1.0 : turns);
}

LocalSurface triangle_point(const Shape& shape, uint32_t primitive, float u, float v) {
  const UVec3& index = shape.mesh.triangles[primitive];
  const auto corners = [&](const std::vector<Vec3>& of) {
    const auto at = [&](uint32_t i) { return lanes(DVec3(of[i])); };
    return scalar::TriangleCorners<double>{at(index.x), at(index.y), at(index.z)};
  };
  scalar::TrianglePlane<double> plane;
  scalar::set_plane(corners(shape.mesh.positions), plane);
  LocalSurface local = scalar::triangle_surface<double>(plane, u, v);
  if (!shape.mesh.normals.empty()) {
    local.shading = scalar::interpolated_normal<double>(corners(shape.mesh.normals), u, v, local.normal);
  }
  return local;
}

struct AnalyticPoint {
  LocalSurface local;
  Vec2 uv = Vec2(0.0f);
};

// `q` is the hit in object space, off the shape by the rounding of t.
AnalyticPoint analytic_point(ShapeKind kind, const DVec3& q) {
  DVec3 position(q.x, q.y, 0.0), normal(0.0, 0.0, 1.0);
  Vec2 uv;
  const double across = std::sqrt(q.x * q.x + q.y * q.y);
  switch (kind) {
    case ShapeKind::sphere: {
      const double length = glm::length(q);
      position = normal = length > 0.0 ? q / length : DVec3(0.0, 0.0, 1.0);
      uv = {turn_fraction(position.y, position.x),
            float(std::acos(std::clamp(position.z, -1.0, 1.0)) / 3.14159265358979323846)};
      break;
    }
    case ShapeKind::cylinder:
      position = across > 0.0 ? DVec3(q.x / across, q.y / across, q.z) : DVec3(1.0, 0.0, q.z);
      normal = {position.x, position.y, 0.0};
      uv = {turn_fraction(q.y, q.x), float(q.z)};
      break;
    case ShapeKind::disk:
    case ShapeKind::mesh:
    case ShapeKind::rectangle:
      uv = {float(across), turn_fraction(q.y, q.x)};
      break;
  }
  // The analytic shapes have size 1, so their query error is k_least_share itself.
  return {{lanes(position), lanes(normal), lanes(normal), glm::length(normal), scalar::k_least_share}, uv};
}

float next_float(double a) {
  float next;
  scalar::store_next_floats(a, &next);
  return next;
}

}  // namespace

Vec2 triangle_uv(const Shape& shape, uint32_t primitive, float u, float v) {
  const TriangleMesh& mesh = shape.mesh;
  const UVec3& corner = mesh.triangles[primitive];
  const double b0 = 1.0 - double(u) - double(v);
  if (shape.kind == ShapeKind::rectangle) {
    const auto coordinate = [&](int axis) {
      const auto at = [&](uint32_t i) { return double(mesh.positions[i][axis]); };
      return float(0.5 * (at(corner.x) * b0 + at(corner.y) * double(u) + at(corner.z) * double(v) + 1.0));
    };
    return {coordinate(0), coordinate(1)};
  }
  if (mesh.texcoords.empty()) return {u, v};
  return mesh.texcoords[corner.x] * float(b0) + mesh.texcoords[corner.y] * u + mesh.texcoords[corner.z] * v;
}

SurfacePoint surface_at(const Scene& scene, const RayBatch& rays, const HitBatch& hits, size_t i) {
  SurfacePoint s;
  s.instance = hits.instance[i];
  s.primitive = hits.primitive[i];
  const Instance& instance = scene.instances[s.instance];
  const Shape& shape = scene.shapes[instance.shape];
  const auto to_object = scalar::splat_affine<double>(&instance.to_object[0][0]);
  LocalSurface local;
  if (is_meshed(shape.kind)) {
    local = triangle_point(shape, s.primitive, hits.u[i], hits.v[i]);
    s.uv = triangle_uv(shape, s.primitive, hits.u[i], hits.v[i]);
  } else {
    const DVec3 world = DVec3(rays.origin(i)) + double(hits.t[i]) * DVec3(rays.direction(i));
    const AnalyticPoint point = analytic_point(shape.kind, to_vec(to_object.point(lanes(world))));
    local = point.local;
    s.uv = point.uv;
  }
  const auto world = scalar::to_world_surface<double>(scalar::splat_affine<double>(&instance.to_world[0][0]), to_object,
                                                      instance.flip_normals ? -1.0 : 1.0, local,
                                                      scalar::to_world_normal<double>(to_object, local.normal), true);
  s.position = Vec3(to_vec(world.position));
  s.geometric_normal = Vec3(to_vec(world.normal));
  s.shading_normal = Vec3(to_vec(world.shading));
  s.error = next_float(world.error);
  return s;
}

void evaluate_surfaces_scalar(const SurfaceTask& task, SurfaceBatch& result) {
  scalar::evaluate_surfaces<float, double>(task, result);
}

SurfacePoint surface_near(const Scene& scene, uint32_t instance_index, uint32_t primitive, const Vec3& position,
                          const Vec3& normal, float error) {
  const Instance& instance = scene.instances[instance_index];
  const Shape& shape = scene.shapes[instance.shape];
  const auto to_world = scalar::splat_affine<double>(&instance.to_world[0][0]);
  const auto to_object = scalar::splat_affine<double>(&instance.to_object[0][0]);
  const UVec3 index = shape.mesh.triangles[primitive];
  const DVec3 p0 = shape.mesh.positions[index.x];
  const DVec3 e1 = DVec3(shape.mesh.positions[index.y]) - p0, e2 = DVec3(shape.mesh.positions[index.z]) - p0;
  const DVec3 plane = glm::cross(e1, e2), beside = to_vec(to_object.point(lanes(DVec3(position)))) - p0;
  const double squared = glm::dot(plane, plane);
  const auto edges = [&](const DVec3& across) {
    const double n = squared > 0.0 ? glm::dot(across, plane) / squared : 0.0;
    return float(std::clamp(n, -k_most_edges, k_most_edges));
  };
  const float u = edges(glm::cross(beside, e2)), v = edges(glm::cross(e1, beside));
  const LocalSurface local = triangle_point(shape, primitive, u, v);
  const DVec3 world_normal = to_vec(to_object.normal(local.normal));
  const bool outside = (glm::dot(world_normal, DVec3(normal)) > 0.0) != instance.flip_normals;

  SurfacePoint s;
  s.instance = instance_index;
  s.primitive = primitive;
  s.position = position;
  s.geometric_normal = s.shading_normal = outside ? normal : -normal;
  // Vertex normals tell which side is which, whatever the triangles' winding.
  if (!shape.mesh.normals.empty()) {
    const Vec3 shading(to_vec(to_object.normal(local.shading)));
    if (glm::length(shading) > 0.0f) s.shading_normal = glm::normalize(instance.flip_normals ? -shading : shading);
  }
  s.uv = triangle_uv(shape, primitive, u, v);
  const double rounding = scalar::rounding_error<double>(to_world, to_object, local, lanes(DVec3(position)),
                                                         lanes(DVec3(normal)), glm::length(world_normal));
  s.error = next_float(double(error) + rounding);
  return s;
}

Vec3 surface_tangent(const Scene& scene, const SurfacePoint& surface) {
  const Instance& instance = scene.instances[surface.instance];
  const Shape& shape = scene.shapes[instance.shape];
  if (shape.kind == ShapeKind::rectangle) return instance.to_world[0];
  if (shape.kind == ShapeKind::mesh) {
    const TriangleMesh& mesh = shape.mesh;
    const UVec3 index = mesh.triangles[surface.primitive];
    const Vec3 e1 = mesh.positions[index.y] - mesh.positions[index.x];
    // Barycentric coordinates stand for texture coordinates.
    if (mesh.texcoords.empty()) return transform_vector(instance.to_world, e1);
    const Vec2 d1 = mesh.texcoords[index.y] - mesh.texcoords[index.x];
    const Vec2 d2 = mesh.texcoords[index.z] - mesh.texcoords[index.x];
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (det == 0.0f) return Vec3(0.0f);
    const Vec3 e2 = mesh.positions[index.z] - mesh.positions[index.x];
    return transform_vector(instance.to_world, (e1 * d2.y - e2 * d1.y) * std::copysign(1.0f, det));
  }
  const Vec3 local = transform_point(instance.to_object, surface.position);
  const Vec3 tangent = shape.kind == ShapeKind::disk ? Vec3(local.x, local.y, 0.0f) : Vec3(-local.y, local.x, 0.0f);
  return transform_vector(instance.to_world, tangent);
}

Vec3 offset_origin(const Vec3& position, const Vec3& geometric_normal, float error, const Vec3& d) {
  return position + geometric_normal * (glm::dot(geometric_normal, d) < 0.0f ? -error : error);
}

}  // namespace fieldtrace
