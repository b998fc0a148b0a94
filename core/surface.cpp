#include "core/surface.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Every relative bound is zero for a surface in a coordinate plane, where an origin on the surface is hit at t = 0 (and
// denormal offsets are flushed to zero). This share of the shape's own size is far below what rounding costs elsewhere
// (2^-24), and its product with the squared size, as in the triangle test, is a normal float for sizes down to 1e-8.
constexpr double k_least_share = 0x1p-40;

// Texture coordinates near a triangle are continued by this many of its edges at most: slivers say nothing farther
// away.
constexpr double k_most_edges = 8.0;

// What a shape knows about a point on it, in object space.
struct LocalPoint {
  DVec3 position = DVec3(0.0);
  DVec3 normal = DVec3(0.0, 0.0, 1.0);   // geometric, any length
  DVec3 shading = DVec3(0.0, 0.0, 1.0);  // any length
  Vec2 uv = Vec2(0.0f);
  // Bound on the error of a ray query's own distance to the surface, along the unit geometric normal.
  double query_error = k_least_share;  // the analytic shapes have size 1
};

DVec3 apply_point(const Affine& a, const DVec3& p) {
  return DVec3(a[0]) * p.x + DVec3(a[1]) * p.y + DVec3(a[2]) * p.z + DVec3(a[3]);
}
DVec3 apply_normal(const Affine& inverse, const DVec3& n) {
  return {glm::dot(DVec3(inverse[0]), n), glm::dot(DVec3(inverse[1]), n), glm::dot(DVec3(inverse[2]), n)};
}
// Componentwise bound |A| |p| + |t|: what rounding errors of A p + t are relative to.
DVec3 magnitude(const Affine& a, const DVec3& p) {
  const DVec3 q = glm::abs(p);
  return glm::abs(DVec3(a[0])) * q.x + glm::abs(DVec3(a[1])) * q.y + glm::abs(DVec3(a[2])) * q.z +
         glm::abs(DVec3(a[3]));
}

// (0, 2 pi) as a fraction of a turn, like Mitsuba's uv on round shapes.
float turn_fraction(double y, double x) {
  const double turns = std::atan2(y, x) * (0.5 / 3.14159265358979323846);
  return float(turns < 0.0 ? turns + 1.0 : turns);
}

// A query computes the triangle's normal as a cross product of rounded edges and projects v0 - o on it: products of
// three factors, summed 2 x 3 times, each with about 8 roundings. The absolute products bound the terms, so the
// error is large for slivers only, where cancellation in the normal is real.
double triangle_query_error(const DVec3& e1, const DVec3& e2, const DVec3& to_v0, const DVec3& normal) {
  const DVec3 a = glm::abs(e1), b = glm::abs(e2);
  const DVec3 terms(a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x);
  const double length = glm::length(normal);
  return length > 0.0 ? double(gamma_bound(8)) * glm::dot(terms, glm::abs(to_v0)) / length : 0.0;
}

LocalPoint triangle_point(const Shape& shape, uint32_t primitive, float u, float v) {
  const TriangleMesh& mesh = shape.mesh;
  const UVec3 index = mesh.triangles[primitive];
  const DVec3 p0 = mesh.positions[index.x], p1 = mesh.positions[index.y], p2 = mesh.positions[index.z];
  const double b1 = u, b2 = v, b0 = 1.0 - b1 - b2;
  LocalPoint local;
  local.position = p0 * b0 + p1 * b1 + p2 * b2;
  const DVec3 e1 = p1 - p0, e2 = p2 - p0;
  local.normal = local.shading = glm::cross(e1, e2);
  local.query_error = triangle_query_error(e1, e2, p0 - local.position, local.normal) +
                      k_least_share * std::max(glm::length(e1), glm::length(e2));
  if (!mesh.normals.empty()) {
    const DVec3 n =
        DVec3(mesh.normals[index.x]) * b0 + DVec3(mesh.normals[index.y]) * b1 + DVec3(mesh.normals[index.z]) * b2;
    if (glm::dot(n, n) > 0.0) local.shading = n;
  }
  if (shape.kind == ShapeKind::rectangle) {
    local.uv = Vec2(0.5 * (local.position.x + 1.0), 0.5 * (local.position.y + 1.0));
  } else if (!mesh.texcoords.empty()) {
    local.uv = mesh.texcoords[index.x] * float(b0) + mesh.texcoords[index.y] * u + mesh.texcoords[index.z] * v;
  } else {
    local.uv = {u, v};
  }
  return local;
}

// `q` is the hit in object space, off the shape by what t lost to rounding.
LocalPoint analytic_point(ShapeKind kind, const DVec3& q) {
  LocalPoint local;
  if (kind == ShapeKind::disk) {
    local.position = {q.x, q.y, 0.0};
    local.uv = {float(std::sqrt(q.x * q.x + q.y * q.y)), turn_fraction(q.y, q.x)};
    return local;
  }
  if (kind == ShapeKind::sphere) {
    const double length = glm::length(q);
    local.position = length > 0.0 ? q / length : DVec3(0.0, 0.0, 1.0);
    local.uv = {turn_fraction(local.position.y, local.position.x),
                float(std::acos(std::clamp(local.position.z, -1.0, 1.0)) / 3.14159265358979323846)};
  } else {
    const double length = std::sqrt(q.x * q.x + q.y * q.y);
    local.position = length > 0.0 ? DVec3(q.x / length, q.y / length, q.z) : DVec3(1.0, 0.0, q.z);
    local.uv = {turn_fraction(q.y, q.x), float(q.z)};
  }
  local.normal = {local.position.x, local.position.y, kind == ShapeKind::sphere ? local.position.z : 0.0};
  local.shading = local.normal;
  return local;
}

// Bound on what rounding makes of a point on the surface along its unit normal, `world` being its position.
// normal_length: of the image of local.normal.
double rounding_error(const Instance& instance, const LocalPoint& local, const DVec3& world, const DVec3& unit_normal,
                      double normal_length) {
  // World: the position is rounded once, and the offset origin once more in product and sum.
  double error = double(gamma_bound(3)) * glm::dot(glm::abs(unit_normal), glm::abs(world));
  // Object: 3 products and 3 sums with a matrix that the query inverted itself: its entries are off by a few roundings
  // of magnitudes that |to_object| and |to_world| bound, hence twice the roundings of one transform on both ways.
  const double local_length = glm::length(local.normal);
  if (local_length > 0.0 && normal_length > 0.0) {
    const DVec3 into_object = magnitude(instance.to_object, world);
    const double local_error =
        double(gamma_bound(12)) * glm::dot(glm::abs(local.normal), into_object) / local_length + local.query_error;
    // A plane that lies d away in object space lies d |n| / |A^-T n| away in world space.
    error += local_error * local_length / normal_length;
    error += double(gamma_bound(6)) * glm::dot(glm::abs(unit_normal), magnitude(instance.to_world, local.position));
  }
  return error;
}

bool is_meshed(ShapeKind kind) { return kind == ShapeKind::mesh || kind == ShapeKind::rectangle; }

}  // namespace

SurfacePoint surface_at(const Scene& scene, const RayBatch& rays, const HitBatch& hits, size_t i) {
  SurfacePoint s;
  s.instance = hits.instance[i];
  s.primitive = hits.primitive[i];
  const Instance& instance = scene.instances[s.instance];
  const Shape& shape = scene.shapes[instance.shape];
  LocalPoint local;
  if (is_meshed(shape.kind)) {
    local = triangle_point(shape, s.primitive, hits.u[i], hits.v[i]);
  } else {
    const DVec3 world = DVec3(rays.origin(i)) + double(hits.t[i]) * DVec3(rays.direction(i));
    local = analytic_point(shape.kind, apply_point(instance.to_object, world));
  }

  const DVec3 world = apply_point(instance.to_world, local.position);
  const double sign = instance.flip_normals ? -1.0 : 1.0;
  const DVec3 normal = apply_normal(instance.to_object, local.normal);
  const double normal_length = glm::length(normal);
  const DVec3 unit_normal = normal_length > 0.0 ? normal / normal_length : DVec3(0.0, 0.0, 1.0);
  const DVec3 shading = apply_normal(instance.to_object, local.shading);
  const double shading_length = glm::length(shading);
  s.position = Vec3(world);
  s.geometric_normal = Vec3(sign * unit_normal);
  s.shading_normal = shading_length > 0.0 ? Vec3(sign * shading / shading_length) : s.geometric_normal;
  s.uv = local.uv;
  const double error = rounding_error(instance, local, world, unit_normal, normal_length);
  s.error = std::nextafter(float(error), k_infinity);
  return s;
}

SurfacePoint surface_near(const Scene& scene, uint32_t instance_index, uint32_t primitive, const Vec3& position,
                          const Vec3& normal, float error) {
  const Instance& instance = scene.instances[instance_index];
  const Shape& shape = scene.shapes[instance.shape];
  const UVec3 index = shape.mesh.triangles[primitive];
  const DVec3 p0 = shape.mesh.positions[index.x];
  const DVec3 e1 = DVec3(shape.mesh.positions[index.y]) - p0, e2 = DVec3(shape.mesh.positions[index.z]) - p0;
  const DVec3 plane = glm::cross(e1, e2), beside = apply_point(instance.to_object, position) - p0;
  const double squared = glm::dot(plane, plane);
  const auto edges = [&](const DVec3& across) {
    const double n = squared > 0.0 ? glm::dot(across, plane) / squared : 0.0;
    return float(std::clamp(n, -k_most_edges, k_most_edges));
  };
  const LocalPoint local =
      triangle_point(shape, primitive, edges(glm::cross(beside, e2)), edges(glm::cross(e1, beside)));
  const DVec3 world_normal = apply_normal(instance.to_object, local.normal);
  const bool outside = (glm::dot(world_normal, DVec3(normal)) > 0.0) != instance.flip_normals;

  SurfacePoint s;
  s.instance = instance_index;
  s.primitive = primitive;
  s.position = position;
  s.geometric_normal = s.shading_normal = outside ? normal : -normal;
  s.uv = local.uv;
  const double rounding = rounding_error(instance, local, position, normal, glm::length(world_normal));
  s.error = std::nextafter(float(double(error) + rounding), k_infinity);
  return s;
}

Vec3 surface_tangent(const Scene& scene, const SurfacePoint& surface) {
  const Instance& instance = scene.instances[surface.instance];
  const Shape& shape = scene.shapes[instance.shape];
  if (shape.kind == ShapeKind::rectangle) return instance.to_world[0];
  if (shape.kind == ShapeKind::mesh) {
    const TriangleMesh& mesh = shape.mesh;
    if (mesh.texcoords.empty()) return Vec3(0.0f);
    const UVec3 index = mesh.triangles[surface.primitive];
    const Vec2 d1 = mesh.texcoords[index.y] - mesh.texcoords[index.x];
    const Vec2 d2 = mesh.texcoords[index.z] - mesh.texcoords[index.x];
    const float det = d1.x * d2.y - d1.y * d2.x;
    if (det == 0.0f) return Vec3(0.0f);
    const Vec3 e1 = mesh.positions[index.y] - mesh.positions[index.x];
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
