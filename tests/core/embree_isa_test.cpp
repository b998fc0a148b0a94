// The tracer with the instruction sets that Embree has for other machines, whose packets have other widths.

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

// What rays meet, as every query tells it.
struct Answers {
  std::vector<uint8_t> of_listed, of_shape;
  std::vector<uint32_t> primitives, of_shapes;

  bool operator==(const Answers&) const = default;
};

// Of rays from within a ball about a knot, some listed, in numbers that fill no packet.
Answers answers_of(const char* config, size_t listed) {
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
  Answers answers{{blocked.begin(), blocked.end()}, {}, {}, {}};
  accel.shape_occluded(0, rays, blocked.data());
  answers.of_shape.assign(blocked.begin(), blocked.begin() + long(rays.size));
  HitBatch hits;
  hits.resize(rays.size);
  accel.intersect(rays, hits, Coherence::coherent);
  for (size_t i = 0; i < rays.size; ++i)
    answers.primitives.push_back(hits.instance[i] != k_none ? hits.primitive[i] : k_none);
  ShapeHits of_shape;
  of_shape.resize(rays.size);
  accel.shape_intersect(0, rays, of_shape);
  answers.of_shapes.assign(of_shape.primitive.begin(), of_shape.primitive.begin() + long(rays.size));
  return answers;
}

TEST(EmbreeIsa, PacketsInPartAreTracedByAll) {
  size_t hits = 0;
  for (const size_t listed : {1u, 7u, 23u, 250u}) {
    const Answers expected = answers_of(nullptr, listed);
    hits += size_t(std::count(expected.of_listed.begin(), expected.of_listed.end(), 1));
    EXPECT_EQ(expected.primitives, expected.of_shapes);
    for (const char* config : {"isa=sse2", "isa=sse4.2", "isa=avx", "isa=avx2"}) {
      EXPECT_TRUE(answers_of(config, listed) == expected) << config << " " << listed;
    }
  }
  EXPECT_GT(hits, 15u);
}

}  // namespace
}  // namespace fieldtrace
