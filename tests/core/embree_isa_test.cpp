// The tracer with the instruction sets that Embree has for other machines, which cut packets of 16 rays.

#include <dlfcn.h>
#include <embree3/rtcore.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/mesh/mesh_procedural.h"
#include "core/trace/accel.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace {
const char* embree_config = nullptr;
}

// Instead of Embree's own, which this one calls.
extern "C" RTCDevice rtcNewDevice(const char*) {
  using NewDevice = RTCDevice (*)(const char*);
  return reinterpret_cast<NewDevice>(dlsym(RTLD_NEXT, "rtcNewDevice"))(embree_config);
}

namespace fieldtrace {
namespace {

// Of rays from within a ball about a knot, some listed, in numbers that fill no packet.
std::vector<uint8_t> blocked_by(const char* config, size_t listed) {
  embree_config = config;
  test::SceneMaker s;
  s.instance(s.mesh(make_knot({.along = 64, .around = 8})), s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), Affine(1.0f));
  const Accel accel(s.scene);
  TestRandom random(5);
  RayBatch rays;
  rays.resize(2 * listed);
  for (size_t i = 0; i < rays.size; ++i) rays.set(i, random.in_ball() * 2.0f, random.direction(), k_infinity);
  std::vector<uint32_t> indices(listed);
  std::iota(indices.begin(), indices.end(), 0u);
  for (uint32_t& i : indices) i = 2 * i + 1;
  AlignedVector<uint8_t> blocked(padded(rays.size), 0);
  accel.occluded(rays, indices, blocked.data());
  return {blocked.begin(), blocked.end()};
}

TEST(EmbreeIsa, PacketsInPartAreTracedByAll) {
  size_t hits = 0;
  for (const size_t listed : {1u, 7u, 23u, 250u}) {
    const std::vector<uint8_t> expected = blocked_by(nullptr, listed);
    hits += size_t(std::count(expected.begin(), expected.end(), 1));
    for (const char* config : {"isa=sse2", "isa=sse4.2", "isa=avx", "isa=avx2"}) {
      EXPECT_EQ(blocked_by(config, listed), expected) << config << " " << listed;
    }
  }
  EXPECT_GT(hits, 15u);
}

}  // namespace
}  // namespace fieldtrace
