// Instances attached to an Embree scene against the same triangles in Embree.
#include <embree3/rtcore.h>

#include <cmath>
#include <random>
#include <thread>

#include "fieldtrace/fieldtrace_embree.h"
#include "tests/support/api_scene.h"

namespace fieldtrace {
namespace {

using test::ApiScene;

class AttachedScene : public ::testing::Test {
 protected:
  AttachedScene() : embree_(rtcNewDevice(nullptr)), target_(rtcNewScene(embree_)), oracle_(rtcNewScene(embree_)) {}
  ~AttachedScene() override {
    rtcReleaseScene(target_);
    rtcReleaseScene(oracle_);
    rtcReleaseDevice(embree_);
  }

  void attach() {
    ASSERT_EQ(ftAttachEmbree(s_.scene, embree_, target_, ids_), FT_ERROR_NONE);
    rtcCommitScene(target_);
    ASSERT_EQ(rtcGetDeviceError(embree_), RTC_ERROR_NONE);
  }
  void detach() {
    ASSERT_EQ(ftDetachEmbree(s_.scene, target_), FT_ERROR_NONE);
    rtcCommitScene(target_);
  }

  // Every instance's triangles, in world space.
  void make_oracle() {
    rtcReleaseScene(oracle_);
    oracle_ = rtcNewScene(embree_);
    const Scene& scene = s_.same.scene;
    for (uint32_t i = 0; i < scene.instances.size(); ++i) {
      const Instance& placed = scene.instances[i];
      const TriangleMesh& mesh = scene.shapes[placed.shape].mesh;
      RTCGeometry g = rtcNewGeometry(embree_, RTC_GEOMETRY_TYPE_TRIANGLE);
      auto* const p = static_cast<Vec3*>(rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                 sizeof(Vec3), mesh.positions.size()));
      auto* const t = static_cast<UVec3*>(
          rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(UVec3), mesh.triangles.size()));
      for (size_t k = 0; k < mesh.positions.size(); ++k) p[k] = transform_point(placed.to_world, mesh.positions[k]);
      std::copy(mesh.triangles.begin(), mesh.triangles.end(), t);
      rtcCommitGeometry(g);
      rtcAttachGeometryByID(oracle_, g, i);
      rtcReleaseGeometry(g);
    }
    rtcCommitScene(oracle_);
  }

  ApiScene s_;
  RTCDevice embree_;
  RTCScene target_, oracle_;
  uint32_t ids_[3] = {9, 9, 9};
};

RTCRayHit random_ray(std::mt19937& random) {
  std::uniform_real_distribution<float> x(-3.0f, 3.0f), y(0.05f, 4.0f), unit(0.0f, 1.0f);
  const Vec3 a(x(random), y(random), x(random)), b(x(random), y(random), x(random));
  const Vec3 d = (b - a) * (0.2f + 3.0f * unit(random));
  RTCRayHit r = {};
  r.ray.org_x = a.x, r.ray.org_y = a.y, r.ray.org_z = a.z;
  r.ray.dir_x = d.x, r.ray.dir_y = d.y, r.ray.dir_z = d.z;
  const float kind = unit(random);
  r.ray.tnear = kind < 0.3f ? unit(random) : 0.0f;
  r.ray.tfar = kind < 0.5f ? k_infinity : 2.0f * unit(random) + r.ray.tnear;
  r.ray.mask = 0xffffffffu;
  r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return r;
}

RTCRayHit intersect_one(RTCScene scene, RTCRayHit r) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &r);
  return r;
}

bool occluded_one(RTCScene scene, RTCRayHit r) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &r.ray);
  return r.ray.tfar < 0.0f;
}

template <int N, class Packet>
void set_lane(Packet& p, int lane, const RTCRay& r) {
  p.org_x[lane] = r.org_x, p.org_y[lane] = r.org_y, p.org_z[lane] = r.org_z, p.tnear[lane] = r.tnear;
  p.dir_x[lane] = r.dir_x, p.dir_y[lane] = r.dir_y, p.dir_z[lane] = r.dir_z, p.tfar[lane] = r.tfar;
  p.time[lane] = 0.0f, p.mask[lane] = r.mask, p.id[lane] = unsigned(lane), p.flags[lane] = 0;
}

// Whether the processor takes packets of so many rays whole.
bool is_native(RTCScene scene, int rays) {
  const RTCDevice device = rtcGetSceneDevice(scene);
  const auto property = rays == 4   ? RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED
                        : rays == 8 ? RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED
                                    : RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED;
  const bool is_supported = rtcGetDeviceProperty(device, property) != 0;
  rtcReleaseDevice(device);
  return is_supported;
}

// The rays in packets of N, of which every seventh lane is off: then as the ray was.
template <int N, class RayHit, class Intersect>
std::vector<RTCRayHit> in_packets(RTCScene scene, const std::vector<RTCRayHit>& rays, const Intersect& intersect) {
  std::vector<RTCRayHit> results = rays;
  // Embree traces inactive rays, too, of packets that it cuts.
  const bool is_cut = !is_native(scene, N);
  for (size_t begin = 0; begin + N <= rays.size(); begin += N) {
    alignas(64) RayHit p;
    alignas(64) int valid[N];
    for (int lane = 0; lane < N; ++lane) {
      set_lane<N>(p.ray, lane, rays[begin + size_t(lane)].ray);
      p.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
      valid[lane] = (begin + size_t(lane)) % 7 == 6 ? 0 : -1;
    }
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    intersect(valid, scene, &context, &p);
    for (int lane = 0; lane < N; ++lane) {
      if (is_cut && valid[lane] == 0) continue;
      RTCRayHit& r = results[begin + size_t(lane)];
      r.ray.tfar = p.ray.tfar[lane], r.hit.geomID = p.hit.geomID[lane], r.hit.primID = p.hit.primID[lane];
      r.hit.u = p.hit.u[lane], r.hit.v = p.hit.v[lane];
    }
  }
  return results;
}

std::vector<RTCRayHit> random_rays(size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<RTCRayHit> rays;
  while (rays.size() < count) rays.push_back(random_ray(random));
  return rays;
}

// Distances are in units of the direction, whatever its length.
TEST_F(AttachedScene, DirectionsMayHaveAnyLength) {
  attach();
  for (const RTCRayHit& r : random_rays(2000, 9)) {
    const RTCRayHit expected = intersect_one(target_, r);
    for (const float scale : {1e-12f, 1e12f}) {
      RTCRayHit scaled = r;
      scaled.ray.dir_x *= scale, scaled.ray.dir_y *= scale, scaled.ray.dir_z *= scale;
      scaled.ray.tnear /= scale, scaled.ray.tfar /= scale;
      const RTCRayHit a = intersect_one(target_, scaled);
      if (a.hit.geomID != expected.hit.geomID || a.hit.primID != expected.hit.primID) continue;  // edges
      if (a.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
      ASSERT_NEAR(a.ray.tfar * scale, expected.ray.tfar, 1e-4f * (1.0f + expected.ray.tfar)) << scale;
      EXPECT_EQ(occluded_one(target_, scaled), true);
    }
  }
}

TEST_F(AttachedScene, HitsAreThoseOfItsTriangles) {
  attach();
  make_oracle();
  const std::vector<RTCRayHit> rays = random_rays(20000, 1);
  size_t hits = 0, unlike = 0;
  for (const RTCRayHit& r : rays) {
    const RTCRayHit a = intersect_one(target_, r), e = intersect_one(oracle_, r);
    if ((a.hit.geomID == RTC_INVALID_GEOMETRY_ID) != (e.hit.geomID == RTC_INVALID_GEOMETRY_ID)) {
      ++unlike;
      continue;
    }
    if (a.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    ++hits;
    if (a.hit.geomID != ids_[e.hit.geomID] || a.hit.primID != e.hit.primID) {
      ++unlike;
      continue;
    }
    const Vec3 d(r.ray.dir_x, r.ray.dir_y, r.ray.dir_z);
    ASSERT_NEAR(a.ray.tfar * glm::length(d), e.ray.tfar * glm::length(d), 1e-3f);
    const Vec3 n(a.hit.Ng_x, a.hit.Ng_y, a.hit.Ng_z);
    const Vec3 same = glm::normalize(Vec3(e.hit.Ng_x, e.hit.Ng_y, e.hit.Ng_z));
    ASSERT_NEAR(glm::length(n), 1.0f, 1e-4f);
    ASSERT_GT(std::abs(glm::dot(n, same)), 0.99f);
    ASSERT_EQ(a.hit.instID[0], RTC_INVALID_GEOMETRY_ID);
  }
  EXPECT_GT(hits, 4000u);
  EXPECT_LE(unlike, rays.size() / 500);  // at edges, and where a certified miss grazes
  detach();
}

TEST_F(AttachedScene, OcclusionIsThatOfItsTriangles) {
  attach();
  make_oracle();
  const std::vector<RTCRayHit> rays = random_rays(20000, 2);
  size_t blocked = 0, unlike = 0;
  for (const RTCRayHit& r : rays) {
    const bool is_blocked = occluded_one(oracle_, r);
    blocked += is_blocked;
    unlike += occluded_one(target_, r) != is_blocked;
  }
  EXPECT_GT(blocked, 4000u);
  EXPECT_LE(unlike, rays.size() / 500);
  detach();
}

TEST_F(AttachedScene, PacketsAreTheirRays) {
  attach();
  const std::vector<RTCRayHit> rays = random_rays(1600, 3);
  const auto check = [&](const std::vector<RTCRayHit>& packets) {
    for (size_t i = 0; i < rays.size(); ++i) {
      const RTCRayHit one = i % 7 == 6 ? rays[i] : intersect_one(target_, rays[i]);
      ASSERT_EQ(packets[i].hit.geomID, one.hit.geomID) << i;
      ASSERT_EQ(packets[i].ray.tfar, one.ray.tfar) << i;
      if (one.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
      ASSERT_EQ(packets[i].hit.primID, one.hit.primID) << i;
      ASSERT_EQ(packets[i].hit.u, one.hit.u) << i;
    }
  };
  check(in_packets<4, RTCRayHit4>(target_, rays, rtcIntersect4));
  check(in_packets<8, RTCRayHit8>(target_, rays, rtcIntersect8));
  check(in_packets<16, RTCRayHit16>(target_, rays, rtcIntersect16));
  std::vector<RTCRayHit> stream = rays;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1M(target_, &context, stream.data(), unsigned(stream.size()), sizeof(RTCRayHit));
  for (size_t i = 6; i < stream.size(); i += 7) stream[i] = rays[i];
  check(stream);
  detach();
}

TEST_F(AttachedScene, FollowsTransforms) {
  attach();
  const Affine moved(Vec3(-0.4f, 0.2f, 0), Vec3(0.1f, 0.9f, 0.2f), Vec3(0, 0.3f, 1.2f), Vec3(0.5f, 2.5f, -1));
  float columns[12];
  test::columns_of(moved, columns);
  ASSERT_EQ(ftSetInstanceTransform(s_.scene, 0, columns), FT_ERROR_NONE);
  s_.same.scene.instances[0].to_world = moved;
  ASSERT_EQ(ftCommitScene(s_.scene), FT_ERROR_NONE);
  rtcCommitGeometry(rtcGetGeometry(target_, ids_[0]));
  rtcCommitScene(target_);
  make_oracle();
  const std::vector<RTCRayHit> rays = random_rays(5000, 4);
  size_t unlike = 0;
  for (const RTCRayHit& r : rays) unlike += occluded_one(target_, r) != occluded_one(oracle_, r);
  EXPECT_LE(unlike, rays.size() / 500);
  detach();
}

TEST_F(AttachedScene, OutlivesItsHandle) {
  attach();
  make_oracle();
  std::atomic<size_t> unlike = 0;
  const std::vector<RTCRayHit> rays = random_rays(4000, 5);
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&] {
      for (const RTCRayHit& r : rays) unlike += occluded_one(target_, r) != occluded_one(oracle_, r);
    });
  }
  // While they trace: the last references go, and what is attached keeps the scene.
  const std::pair<FTDevice, FTScene> handles = s_.take();
  const FTScene scene = handles.second;
  EXPECT_EQ(ftReleaseDevice(handles.first), FT_ERROR_NONE);
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  for (std::thread& t : threads) t.join();
  EXPECT_LE(unlike, 8 * rays.size() / 500);
  EXPECT_EQ(ftDetachEmbree(scene, target_), FT_ERROR_NONE);
  rtcCommitScene(target_);
  EXPECT_FALSE(occluded_one(target_, rays[0]));
  EXPECT_EQ(ftDetachEmbree(scene, target_), FT_ERROR_INVALID_ARGUMENT);
}

TEST_F(AttachedScene, Errors) {
  EXPECT_EQ(ftAttachEmbree(nullptr, embree_, target_, ids_), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAttachEmbree(s_.scene, nullptr, target_, ids_), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAttachEmbree(s_.scene, embree_, nullptr, ids_), FT_ERROR_INVALID_ARGUMENT);
  RTCDevice other = rtcNewDevice(nullptr);
  EXPECT_EQ(ftAttachEmbree(s_.scene, other, target_, ids_), FT_ERROR_INVALID_ARGUMENT);
  rtcReleaseDevice(other);
  const ApiScene uncommitted(false);
  EXPECT_EQ(ftAttachEmbree(uncommitted.scene, embree_, target_, ids_), FT_ERROR_INVALID_OPERATION);
  EXPECT_EQ(ids_[0], 9u);
  EXPECT_EQ(ftDetachEmbree(s_.scene, target_), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftDetachEmbree(nullptr, target_), FT_ERROR_INVALID_ARGUMENT);
  ASSERT_EQ(ftAttachEmbree(s_.scene, embree_, target_, nullptr), FT_ERROR_NONE);
  EXPECT_EQ(ftAttachEmbree(s_.scene, embree_, target_, ids_), FT_ERROR_INVALID_ARGUMENT);
  const char* message = nullptr;
  EXPECT_EQ(ftGetDeviceError(s_.device, &message), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_STREQ(message, "ftAttachEmbree: this scene is attached to that Embree scene already");
  EXPECT_EQ(ftDetachEmbree(s_.scene, target_), FT_ERROR_NONE);
  EXPECT_EQ(ftDetachEmbree(s_.scene, target_), FT_ERROR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace fieldtrace
