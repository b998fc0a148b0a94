#include "core/trace/accel_analytic.h"

#include <bit>
#include <cmath>

namespace fieldtrace {
namespace {

// Both roots of |o + t d|^2 = 1 for vectors of any dimension; false if the line misses.
template <class V>
bool unit_quadric_roots(const V& o, const V& d, double& t0, double& t1) {
  const double a = glm::dot(d, d);
  if (!(a > 0.0)) return false;
  const double t_foot = -glm::dot(o, d) / a;
  const V foot = o + t_foot * d;
  const double discriminant = 1.0 - glm::dot(foot, foot);
  if (!(discriminant >= 0.0)) return false;
  const double half = std::sqrt(discriminant / a);
  t0 = t_foot - half;
  t1 = t_foot + half;
  return true;
}

ShapeKind kind_of(void* user) { return ShapeKind(std::bit_cast<uintptr_t>(user)); }

void bounds_callback(const RTCBoundsFunctionArguments* args) {
  const ShapeKind kind = kind_of(args->geometryUserPtr);
  RTCBounds& b = *args->bounds_o;
  b.lower_x = b.lower_y = -1.0f;
  b.upper_x = b.upper_y = 1.0f;
  b.lower_z = kind == ShapeKind::sphere ? -1.0f : 0.0f;
  b.upper_z = kind == ShapeKind::disk ? 0.0f : 1.0f;
}

DVec3 ray_origin(RTCRayN* r, unsigned n, unsigned i) {
  return {RTCRayN_org_x(r, n, i), RTCRayN_org_y(r, n, i), RTCRayN_org_z(r, n, i)};
}
DVec3 ray_direction(RTCRayN* r, unsigned n, unsigned i) {
  return {RTCRayN_dir_x(r, n, i), RTCRayN_dir_y(r, n, i), RTCRayN_dir_z(r, n, i)};
}

void intersect_callback(const RTCIntersectFunctionNArguments* args) {
  const unsigned n = args->N;
  RTCRayN* ray = RTCRayHitN_RayN(args->rayhit, n);
  RTCHitN* hit = RTCRayHitN_HitN(args->rayhit, n);
  const ShapeKind kind = kind_of(args->geometryUserPtr);
  for (unsigned i = 0; i < n; ++i) {
    if (args->valid[i] != -1) continue;
    DVec3 normal;
    const double t = intersect_analytic(kind, ray_origin(ray, n, i), ray_direction(ray, n, i), RTCRayN_tnear(ray, n, i),
                                        RTCRayN_tfar(ray, n, i), normal);
    if (t < 0.0) continue;
    RTCRayN_tfar(ray, n, i) = float(t);
    RTCHitN_Ng_x(hit, n, i) = float(normal.x);
    RTCHitN_Ng_y(hit, n, i) = float(normal.y);
    RTCHitN_Ng_z(hit, n, i) = float(normal.z);
    RTCHitN_u(hit, n, i) = 0.0f;
    RTCHitN_v(hit, n, i) = 0.0f;
    RTCHitN_primID(hit, n, i) = args->primID;
    RTCHitN_geomID(hit, n, i) = args->geomID;
    RTCHitN_instID(hit, n, i, 0) = args->context->instID[0];
  }
}

void occluded_callback(const RTCOccludedFunctionNArguments* args) {
  const unsigned n = args->N;
  const ShapeKind kind = kind_of(args->geometryUserPtr);
  for (unsigned i = 0; i < n; ++i) {
    if (args->valid[i] != -1) continue;
    DVec3 normal;
    const double t = intersect_analytic(kind, ray_origin(args->ray, n, i), ray_direction(args->ray, n, i),
                                        RTCRayN_tnear(args->ray, n, i), RTCRayN_tfar(args->ray, n, i), normal);
    if (t >= 0.0) RTCRayN_tfar(args->ray, n, i) = -k_infinity;
  }
}

}  // namespace

double intersect_analytic(ShapeKind kind, const DVec3& o, const DVec3& d, double t_min, double t_max, DVec3& normal) {
  const auto inside = [&](double t) { return t >= t_min && t <= t_max; };
  if (kind == ShapeKind::disk) {
    if (d.z == 0.0) return -1.0;
    const double t = -o.z / d.z;
    const DVec3 p = o + t * d;
    normal = {0.0, 0.0, 1.0};
    return inside(t) && p.x * p.x + p.y * p.y <= 1.0 ? t : -1.0;
  }
  double roots[2];
  if (kind == ShapeKind::sphere) {
    if (!unit_quadric_roots(o, d, roots[0], roots[1])) return -1.0;
    for (const double t : roots) {
      if (!inside(t)) continue;
      normal = o + t * d;
      return t;
    }
    return -1.0;
  }
  if (!unit_quadric_roots(glm::dvec2(o), glm::dvec2(d), roots[0], roots[1])) return -1.0;
  for (const double t : roots) {
    const DVec3 p = o + t * d;
    if (!inside(t) || p.z < 0.0 || p.z > 1.0) continue;
    normal = {p.x, p.y, 0.0};
    return t;
  }
  return -1.0;
}

RTCGeometry new_analytic_geometry(RTCDevice device, ShapeKind kind) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, 1);
  rtcSetGeometryUserData(geometry, std::bit_cast<void*>(uintptr_t(kind)));
  rtcSetGeometryBoundsFunction(geometry, bounds_callback, nullptr);
  rtcSetGeometryIntersectFunction(geometry, intersect_callback);
  rtcSetGeometryOccludedFunction(geometry, occluded_callback);
  return geometry;
}

}  // namespace fieldtrace
