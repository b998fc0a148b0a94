#include "core/trace/user_geometry.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <string>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

const UserGeometry& geometry_of(void* user) { return *static_cast<const UserGeometry*>(user); }

// The rays of a callback that are valid, and which lanes they are. Begins are moved to tnear, since queries begin at 0.
struct CallbackRays {
  RayBatch rays;
  unsigned lanes[k_most_user_rays];
  float begins[k_most_user_rays];

  void take(const int* valid, RTCRayN* from, unsigned begin, unsigned end, unsigned n) {
    rays.resize(end - begin);
    size_t count = 0;
    for (unsigned i = begin; i < end; ++i) {
      if (!valid[i]) continue;
      const Vec3 origin(RTCRayN_org_x(from, n, i), RTCRayN_org_y(from, n, i), RTCRayN_org_z(from, n, i));
      const Vec3 direction(RTCRayN_dir_x(from, n, i), RTCRayN_dir_y(from, n, i), RTCRayN_dir_z(from, n, i));
      const float near = std::max(RTCRayN_tnear(from, n, i), 0.0f);
      lanes[count] = i, begins[count] = near;
      rays.set(count, near > 0.0f ? origin + near * direction : origin, direction, RTCRayN_tfar(from, n, i) - near);
      ++count;
    }
    rays.resize(count);
  }
};

// Calls body(rays) for the valid rays of a callback, k_most_user_rays lanes at a time.
template <class Body>
void for_rays(const int* valid, RTCRayN* from, unsigned n, const Body& body) {
  thread_local CallbackRays rays;  // allocating costs more than a look-up
  for (unsigned begin = 0; begin < n; begin += unsigned(k_most_user_rays)) {
    rays.take(valid, from, begin, std::min(n, begin + unsigned(k_most_user_rays)), n);
    if (rays.rays.size > 0) body(rays);
  }
}

void call_bounds(const RTCBoundsFunctionArguments* a) {
  const Bounds3 b = geometry_of(a->geometryUserPtr).bounds();
  RTCBounds& to = *a->bounds_o;
  to.lower_x = b.lower.x, to.lower_y = b.lower.y, to.lower_z = b.lower.z;
  to.upper_x = b.upper.x, to.upper_y = b.upper.y, to.upper_z = b.upper.z;
}

void call_intersect(const RTCIntersectFunctionNArguments* a) {
  const unsigned n = a->N;
  RTCRayN* const ray = RTCRayHitN_RayN(a->rayhit, n);
  RTCHitN* const hit = RTCRayHitN_HitN(a->rayhit, n);
  for_rays(a->valid, ray, n, [&](const CallbackRays& r) {
    UserGeometry::Hit hits[k_most_user_rays];
    geometry_of(a->geometryUserPtr).intersect(r.rays, hits);
    for (size_t k = 0; k < r.rays.size; ++k) {
      if (!hits[k].is_hit) continue;
      const unsigned i = r.lanes[k];
      RTCRayN_tfar(ray, n, i) = r.begins[k] + hits[k].t;
      RTCHitN_Ng_x(hit, n, i) = hits[k].normal.x;
      RTCHitN_Ng_y(hit, n, i) = hits[k].normal.y;
      RTCHitN_Ng_z(hit, n, i) = hits[k].normal.z;
      RTCHitN_u(hit, n, i) = hits[k].u;
      RTCHitN_v(hit, n, i) = hits[k].v;
      RTCHitN_primID(hit, n, i) = hits[k].primitive;
      RTCHitN_geomID(hit, n, i) = a->geomID;
      for (unsigned level = 0; level < RTC_MAX_INSTANCE_LEVEL_COUNT; ++level) {
        RTCHitN_instID(hit, n, i, level) = a->context->instID[level];
      }
    }
  });
}

void call_occluded(const RTCOccludedFunctionNArguments* a) {
  for_rays(a->valid, a->ray, a->N, [&](const CallbackRays& r) {
    uint8_t blocked[k_most_user_rays] = {};
    geometry_of(a->geometryUserPtr).occluded(r.rays, blocked);
    for (size_t k = 0; k < r.rays.size; ++k) {
      if (blocked[k]) RTCRayN_tfar(a->ray, a->N, r.lanes[k]) = -k_infinity;
    }
  });
}

}  // namespace

AttachedGeometry::AttachedGeometry(RTCDevice device, RTCScene scene, std::unique_ptr<const UserGeometry> geometry)
    : scene_(scene), geometry_(std::move(geometry)) {
  (void)rtcGetDeviceError(device);  // of earlier calls
  RTCGeometry const made = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  const auto failure = [&] {
    const RTCError code = rtcGetDeviceError(device);
    return code == RTC_ERROR_NONE ? std::string() : "Embree refuses a geometry (error " + std::to_string(code) + ")";
  };
  if (!made) throw Error(failure());
  rtcSetGeometryUserPrimitiveCount(made, 1);
  // Embree hands it back, and changes nothing.
  rtcSetGeometryUserData(made, const_cast<UserGeometry*>(geometry_.get()));
  rtcSetGeometryBoundsFunction(made, call_bounds, nullptr);
  rtcSetGeometryIntersectFunction(made, call_intersect);
  rtcSetGeometryOccludedFunction(made, call_occluded);
  rtcCommitGeometry(made);
  id_ = rtcAttachGeometry(scene, made);
  rtcReleaseGeometry(made);
  const std::string why = failure();
  if (why.empty() && id_ != RTC_INVALID_GEOMETRY_ID) {
    rtcRetainScene(scene);
    return;
  }
  if (id_ != RTC_INVALID_GEOMETRY_ID) rtcDetachGeometry(scene, id_);
  throw Error(why.empty() ? "the device is not that of the Embree scene" : why);
}

AttachedGeometry::~AttachedGeometry() {
  rtcDetachGeometry(scene_, id_);
  rtcReleaseScene(scene_);
}

}  // namespace fieldtrace
