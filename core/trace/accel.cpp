#include "core/trace/accel.h"

#include <embree3/rtcore.h>

#include <atomic>
#include <cstring>
#include <numeric>
#include <string>
#include <vector>

#include "core/platform/error.h"
#include "core/trace/accel_analytic.h"

namespace fieldtrace {
namespace {

// Packets of rays of the width of the processor's vectors: Embree sorts and cuts wider ones.
template <int width, class R, class H, auto trace_nearest, auto trace_any>
struct Packets {
  static constexpr int k_width = width;
  using Ray = R;
  using RayHit = H;
  static constexpr auto intersect = trace_nearest;
  static constexpr auto occluded = trace_any;
};
using Packets8 = Packets<8, RTCRay8, RTCRayHit8, rtcIntersect8, rtcOccluded8>;
using Packets16 = Packets<16, RTCRay16, RTCRayHit16, rtcIntersect16, rtcOccluded16>;

struct DeviceDeleter {
  void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
};
struct SceneDeleter {
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};
using DevicePtr = std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceDeleter>;
using ScenePtr = std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneDeleter>;

RTCIntersectContext make_context(Coherence coherence) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags =
      coherence == Coherence::coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return context;
}

// Sets what the packets of one query share. Inactive lanes need numbers, too: Embree 3 built with assertions, as
// Debian's is, stops at what is none where it cuts packets for AVX2 and less.
template <class Ray>
void prepare(Ray& packet) {
  packet = {};
  for (unsigned lane = 0; lane < std::size(packet.mask); ++lane) {
    packet.mask[lane] = 0xffffffffu;
    packet.id[lane] = lane;
  }
}

// Fills packet entry `lane` with ray `i`. An inactive ray gets tnear > tfar, which Embree skips.
template <class Ray>
void set_ray(Ray& packet, int lane, const RayBatch& rays, size_t i) {
  packet.org_x[lane] = rays.ox[i];
  packet.org_y[lane] = rays.oy[i];
  packet.org_z[lane] = rays.oz[i];
  packet.dir_x[lane] = rays.dx[i];
  packet.dir_y[lane] = rays.dy[i];
  packet.dir_z[lane] = rays.dz[i];
  packet.tfar[lane] = rays.tmax[i];
}

// Fills a packet with rays begin, begin + 1, ..., the batch's padding too: whole vectors are copied.
template <class Ray>
void set_rays(Ray& packet, const RayBatch& rays, size_t begin) {
  const auto copy = [begin](const AlignedVector<float>& from, auto& to) {
    std::memcpy(to, from.data() + begin, sizeof(to));
  };
  copy(rays.ox, packet.org_x), copy(rays.oy, packet.org_y), copy(rays.oz, packet.org_z);
  copy(rays.dx, packet.dir_x), copy(rays.dy, packet.dir_y), copy(rays.dz, packet.dir_z);
  copy(rays.tmax, packet.tfar);
}

// Transforms the first `count` rays of a packet into object space.
template <class Ray>
void transform_packet(Ray& p, int count, const Affine& m) {
  for (int i = 0; i < count; ++i) {
    const Vec3 o = transform_point(m, {p.org_x[i], p.org_y[i], p.org_z[i]});
    const Vec3 d = transform_vector(m, {p.dir_x[i], p.dir_y[i], p.dir_z[i]});
    p.org_x[i] = o.x, p.org_y[i] = o.y, p.org_z[i] = o.z;
    p.dir_x[i] = d.x, p.dir_y[i] = d.y, p.dir_z[i] = d.z;
  }
}

template <int k_width>
void set_valid(int (&valid)[k_width], int count) {
  for (int i = 0; i < k_width; ++i) valid[i] = i < count ? -1 : 0;
}

// Shared by both nearest-hit queries; calls store(packet, begin) for every packet, whose entries belong to rays begin,
// begin + 1, ..., up to the batch's padding. Entries with an invalid geomID are misses.
template <class P, class Store>
void intersect_packets(RTCScene scene, Coherence coherence, const RayBatch& rays, const Store& store) {
  RTCIntersectContext context = make_context(coherence);
  constexpr int k_width = P::k_width;
  alignas(64) int valid[k_width];
  typename P::RayHit packet;
  prepare(packet.ray);
  for (size_t begin = 0; begin < rays.size; begin += k_width) {
    set_rays(packet.ray, rays, begin);
    std::fill_n(packet.hit.geomID, k_width, RTC_INVALID_GEOMETRY_ID);
    std::fill_n(packet.hit.instID[0], k_width, RTC_INVALID_GEOMETRY_ID);
    set_valid(valid, int(std::min(rays.size - begin, size_t(k_width))));
    P::intersect(valid, scene, &context, &packet);
    store(packet, begin);
  }
}

// Whether so many indices follow one another.
template <int k_width>
bool are_consecutive(const uint32_t* indices) {
  uint32_t differences = 0;
  for (uint32_t lane = 0; lane < uint32_t(k_width); ++lane) differences |= indices[lane] ^ (indices[0] + lane);
  return differences == 0;
}

// Shared by both occlusion queries: packs listed rays and marks the occluded ones.
template <class P>
void occluded_packets(RTCScene scene, const Affine* to_object, const RayBatch& rays, std::span<const uint32_t> indices,
                      uint8_t* blocked) {
  RTCIntersectContext context = make_context(Coherence::incoherent);
  constexpr int k_width = P::k_width;
  alignas(64) int valid[k_width];
  typename P::Ray packet;
  prepare(packet);
  for (size_t begin = 0; begin < indices.size(); begin += k_width) {
    const int count = int(std::min(indices.size() - begin, size_t(k_width)));
    if (count == k_width && are_consecutive<k_width>(indices.data() + begin)) {
      set_rays(packet, rays, indices[begin]);
    } else {
      for (int lane = 0; lane < count; ++lane) set_ray(packet, lane, rays, indices[begin + lane]);
    }
    if (to_object) transform_packet(packet, count, *to_object);
    set_valid(valid, count);
    P::occluded(valid, scene, &context, &packet);
    for (int lane = 0; lane < count; ++lane) {
      if (packet.tfar[lane] == -k_infinity) blocked[indices[begin + lane]] = 1;
    }
  }
}

// Sets blocked[i] for every ray.
template <class P>
void occluded_by_shape(RTCScene shape, const RayBatch& rays, uint8_t* blocked) {
  RTCIntersectContext context = make_context(Coherence::incoherent);
  alignas(64) int valid[P::k_width];
  typename P::Ray packet;
  prepare(packet);
  for (size_t begin = 0; begin < rays.size; begin += P::k_width) {
    const int count = int(std::min(rays.size - begin, size_t(P::k_width)));
    set_rays(packet, rays, begin);
    set_valid(valid, count);
    P::occluded(valid, shape, &context, &packet);
    for (int lane = 0; lane < count; ++lane) blocked[begin + lane] = packet.tfar[lane] == -k_infinity;
  }
}

}  // namespace

struct Accel::Impl {
  DevicePtr device;
  std::vector<ScenePtr> shapes;
  ScenePtr top;
  const Scene& scene;
  std::atomic<int64_t> bytes = 0;
  bool has_wide_packets = false;

  explicit Impl(const Scene& s) : scene(s) {
    device.reset(rtcNewDevice(nullptr));
    if (!device)
      throw Error("Embree could not create a device (error " + std::to_string(rtcGetDeviceError(nullptr)) + ")");
    has_wide_packets = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
    rtcSetDeviceMemoryMonitorFunction(
        device.get(),
        [](void* user, ssize_t delta, bool) {
          static_cast<Impl*>(user)->bytes += delta;
          return true;
        },
        this);
    for (uint32_t i = 0; i < s.shapes.size(); ++i) shapes.push_back(build_shape(s.shapes[i]));
    std::vector<uint32_t> all(s.instances.size());
    std::iota(all.begin(), all.end(), 0u);
    top = build_instances(all);
  }

  ~Impl() {
    // Released in this order: scenes before the device, and the device before `bytes`, to which its monitor still
    // writes.
    top.reset();
    shapes.clear();
    device.reset();
  }

  void check(const std::string& what) const {
    const RTCError code = rtcGetDeviceError(device.get());
    if (code != RTC_ERROR_NONE) {
      throw Error("Embree failed while building " + what + " (error " + std::to_string(int(code)) +
                  (code == RTC_ERROR_OUT_OF_MEMORY ? ", out of memory)" : ")"));
    }
  }

  ScenePtr new_scene() const {
    ScenePtr scene_ptr(rtcNewScene(device.get()));
    // Not RTC_SCENE_FLAG_ROBUST: it costs a quarter of the speed, and coherent packets through robust instances do not
    // return in Embree 3.13.5 (docs/decisions/002-embree-packets.md).
    rtcSetSceneFlags(scene_ptr.get(), RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(scene_ptr.get(), RTC_BUILD_QUALITY_MEDIUM);
    return scene_ptr;
  }

  ScenePtr build_shape(const Shape& shape) {
    ScenePtr result = new_scene();
    RTCGeometry geometry;
    if (!is_meshed(shape.kind)) {
      geometry = new_analytic_geometry(device.get(), shape.kind);
    } else {
      geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
      // Copied, because Embree reads 16 bytes at the last vertex.
      const TriangleMesh& mesh = shape.mesh;
      auto* vertices = static_cast<Vec3*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), mesh.positions.size()));
      auto* indices = static_cast<UVec3*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                  sizeof(UVec3), mesh.triangles.size()));
      if (!vertices || !indices) check(shape.name);
      std::copy(mesh.positions.begin(), mesh.positions.end(), vertices);
      std::copy(mesh.triangles.begin(), mesh.triangles.end(), indices);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(result.get(), geometry, 0);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(result.get());
    check(shape.name);
    return result;
  }

  ScenePtr build_instances(std::span<const uint32_t> instances) const {
    ScenePtr result = new_scene();
    for (const uint32_t i : instances) {
      const Instance& instance = scene.instances[i];
      RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE);
      rtcSetGeometryInstancedScene(geometry, shapes[instance.shape].get());
      rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &instance.to_world);
      rtcCommitGeometry(geometry);
      rtcAttachGeometryByID(result.get(), geometry, i);
      rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(result.get());
    check("the scene");
    return result;
  }

  // `only`: the instance that `of` is the shape of; k_none: it holds instances.
  void intersect(RTCScene of, const RayBatch& rays, HitBatch& hits, Coherence coherence, uint32_t only = k_none) const {
    const auto store = [&](const auto& packet, size_t begin) {
      uint32_t* const instance = hits.instance.data() + begin;
      for (size_t lane = 0; lane < std::size(packet.hit.geomID); ++lane) {
        const uint32_t met = only == k_none ? packet.hit.instID[0][lane] : only;
        instance[lane] = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID ? met : k_none;
      }
      const auto copy = [begin](const auto& from, auto& to) { std::memcpy(to.data() + begin, from, sizeof(from)); };
      copy(packet.hit.primID, hits.primitive), copy(packet.ray.tfar, hits.t);
      copy(packet.hit.u, hits.u), copy(packet.hit.v, hits.v);
    };
    by_packets([&](auto packets) { intersect_packets<decltype(packets)>(of, coherence, rays, store); });
  }

  // Calls f with the packets that suit the processor.
  template <class F>
  void by_packets(const F& f) const {
    if (has_wide_packets)
      f(Packets16());
    else
      f(Packets8());
  }
};

class Accel::Group {
 public:
  explicit Group(ScenePtr s) : scene(std::move(s)) {}
  ScenePtr scene;
};

Accel::Accel(const Scene& scene) : impl_(std::make_unique<Impl>(scene)) {}
Accel::~Accel() = default;

void Accel::intersect(const RayBatch& rays, HitBatch& hits, Coherence coherence) const {
  impl_->intersect(impl_->top.get(), rays, hits, coherence);
}

std::shared_ptr<const Accel::Group> Accel::group(std::span<const uint32_t> instances) const {
  return std::make_shared<const Group>(impl_->build_instances(instances));
}

void Accel::intersect(const Group& group, const RayBatch& rays, HitBatch& hits, Coherence coherence) const {
  impl_->intersect(group.scene.get(), rays, hits, coherence);
}

void Accel::occluded(const RayBatch& rays, std::span<const uint32_t> indices, uint8_t* blocked) const {
  impl_->by_packets(
      [&](auto packets) { occluded_packets<decltype(packets)>(impl_->top.get(), nullptr, rays, indices, blocked); });
}

void Accel::occluded_by(uint32_t instance, const RayBatch& rays, std::span<const uint32_t> indices,
                        uint8_t* blocked) const {
  const Instance& placed = impl_->scene.instances[instance];
  impl_->by_packets([&](auto packets) {
    occluded_packets<decltype(packets)>(impl_->shapes[placed.shape].get(), &placed.to_object, rays, indices, blocked);
  });
}

void Accel::intersect_with(uint32_t instance, const RayBatch& rays, HitBatch& hits) const {
  const Instance& placed = impl_->scene.instances[instance];
  thread_local RayBatch in_object;
  in_object.resize(rays.size);
  for (size_t i = 0; i < rays.size; ++i) {
    in_object.set(i, transform_point(placed.to_object, rays.origin(i)),
                  transform_vector(placed.to_object, rays.direction(i)), rays.tmax[i]);
  }
  impl_->intersect(impl_->shapes[placed.shape].get(), in_object, hits, Coherence::incoherent, instance);
}

void Accel::shape_intersect(uint32_t shape, const RayBatch& rays, ShapeHits& hits) const {
  const auto store = [&](const auto& packet, size_t begin) {
    for (size_t lane = 0; lane < std::size(packet.hit.geomID); ++lane) {
      const size_t i = begin + lane;
      const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
      hits.t[i] = hit ? packet.ray.tfar[lane] : -1.0f;
      hits.nx[i] = packet.hit.Ng_x[lane];
      hits.ny[i] = packet.hit.Ng_y[lane];
      hits.nz[i] = packet.hit.Ng_z[lane];
      hits.primitive[i] = hit ? packet.hit.primID[lane] : k_none;
    }
  };
  impl_->by_packets([&](auto packets) {
    intersect_packets<decltype(packets)>(impl_->shapes[shape].get(), Coherence::incoherent, rays, store);
  });
}

void Accel::shape_occluded(uint32_t shape, const RayBatch& rays, uint8_t* blocked) const {
  impl_->by_packets(
      [&](auto packets) { occluded_by_shape<decltype(packets)>(impl_->shapes[shape].get(), rays, blocked); });
}

size_t Accel::memory_bytes() const { return size_t(std::max<int64_t>(impl_->bytes, 0)); }

}  // namespace fieldtrace
