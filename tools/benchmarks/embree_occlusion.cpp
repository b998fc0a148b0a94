#include "tools/benchmarks/embree_occlusion.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <string>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

// Copies rays [begin, begin + count) into a packet of Embree's layout (RTCRay8 or RTCRay16).
template <class Packet>
void fill(Packet& packet, int* valid, int width, const RayBatch& rays, size_t begin) {
  const int count = int(std::min(rays.size - begin, size_t(width)));
  for (int lane = 0; lane < width; ++lane) valid[lane] = lane < count ? -1 : 0;
  for (int lane = 0; lane < count; ++lane) {
    const size_t i = begin + size_t(lane);
    packet.org_x[lane] = rays.ox[i], packet.org_y[lane] = rays.oy[i], packet.org_z[lane] = rays.oz[i];
    packet.dir_x[lane] = rays.dx[i], packet.dir_y[lane] = rays.dy[i], packet.dir_z[lane] = rays.dz[i];
    packet.tnear[lane] = 0.0f;
    packet.tfar[lane] = rays.tmax[i];
    packet.time[lane] = 0.0f;
    packet.mask[lane] = 0xffffffffu;
    packet.id[lane] = 0;
    packet.flags[lane] = 0;
  }
}

// Embree marks an occluded ray by tfar = -infinity.
template <class Packet>
size_t blocked_in(const Packet& packet, const int* valid, int width) {
  size_t n = 0;
  for (int lane = 0; lane < width; ++lane) n += valid[lane] != 0 && packet.tfar[lane] < 0.0f;
  return n;
}

// Number of occluded rays, traced in packets by rtcOccluded8 or rtcOccluded16.
template <class Packet, class Occluded>
size_t count_in_packets(const RayBatch& rays, int width, const Occluded& occluded) {
  alignas(64) int valid[16];
  Packet packet;
  size_t blocked = 0;
  for (size_t begin = 0; begin < rays.size; begin += size_t(width)) {
    fill(packet, valid, width, rays, begin);
    occluded(valid, packet);
    blocked += blocked_in(packet, valid, width);
  }
  return blocked;
}

}  // namespace

const char* packets_name(OcclusionPackets packets) {
  switch (packets) {
    case OcclusionPackets::single:
      return "single";
    case OcclusionPackets::eight_incoherent:
      return "8_incoherent";
    case OcclusionPackets::sixteen_coherent:
      return "16_coherent";
    case OcclusionPackets::sixteen_incoherent:
      return "16_incoherent";
  }
  return "";
}

struct EmbreeOcclusion::Impl {
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = nullptr;

  explicit Impl(const TriangleMesh& mesh) {
    if (!device) throw Error("Embree could not create a device");
    scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<Vec3*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                sizeof(Vec3), mesh.positions.size()));
    auto* indices = static_cast<UVec3*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                sizeof(UVec3), mesh.triangles.size()));
    if (vertices && indices) {
      std::copy(mesh.positions.begin(), mesh.positions.end(), vertices);
      std::copy(mesh.triangles.begin(), mesh.triangles.end(), indices);
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(scene, geometry);
      rtcReleaseGeometry(geometry);
      rtcCommitScene(scene);
    }
    const RTCError error = rtcGetDeviceError(device);
    if (error != RTC_ERROR_NONE) throw Error("Embree could not build the mesh (error " + std::to_string(error) + ")");
  }
  ~Impl() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
};

EmbreeOcclusion::EmbreeOcclusion(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>(mesh)) {}
EmbreeOcclusion::~EmbreeOcclusion() = default;

size_t EmbreeOcclusion::count_blocked(const RayBatch& rays, OcclusionPackets packets) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = packets == OcclusionPackets::sixteen_coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT
                                                                : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  if (packets == OcclusionPackets::eight_incoherent) {
    return count_in_packets<RTCRay8>(
        rays, 8, [&](const int* valid, RTCRay8& packet) { rtcOccluded8(valid, impl_->scene, &context, &packet); });
  }
  if (packets != OcclusionPackets::single) {
    return count_in_packets<RTCRay16>(
        rays, 16, [&](const int* valid, RTCRay16& packet) { rtcOccluded16(valid, impl_->scene, &context, &packet); });
  }
  size_t blocked = 0;
  for (size_t i = 0; i < rays.size; ++i) {
    RTCRay ray;
    ray.org_x = rays.ox[i], ray.org_y = rays.oy[i], ray.org_z = rays.oz[i];
    ray.dir_x = rays.dx[i], ray.dir_y = rays.dy[i], ray.dir_z = rays.dz[i];
    ray.tnear = 0.0f, ray.tfar = rays.tmax[i], ray.time = 0.0f;
    ray.mask = 0xffffffffu, ray.id = 0, ray.flags = 0;
    rtcOccluded1(impl_->scene, &context, &ray);
    blocked += ray.tfar < 0.0f;
  }
  return blocked;
}

}  // namespace fieldtrace
