// The bits of cells: decoding returns what was encoded within its bound; slots of cells are distinct and named by
// slices.
#include "field/store/layout.hd.h"

#include <gtest/gtest.h>

#include <set>

#include "field/store/encode.h"
#include "field/store/field.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

using scalar::decode_depth;
using scalar::decode_error;
using scalar::decode_normal;

TEST(Layout, DepthIsMonotoneAndWithinHalfAQuantum) {
  uint32_t before = 0;
  for (int i = 0; i <= 200000; ++i) {
    const float depth = float(i) * (2.0f / 200000.0f) - 1.0f;
    const uint32_t code = encode_depth(depth);
    ASSERT_GE(code, before);
    before = code;
    // Half a quantum, and the rounding of decoding, whose result is at most 1.
    ASSERT_LE(std::abs(decode_depth<float>(int32_t(code)) - depth), 0.5f * scalar::k_depth_quantum + 0x1p-22f) << depth;
  }
  EXPECT_EQ(before, 65535u);
  EXPECT_EQ(encode_depth(-2.0f), 0u);
  EXPECT_EQ(encode_depth(2.0f), 65535u);
}

TEST(Layout, EveryDepthCodeSurvives) {
  for (uint32_t code = 0; code < 65536; ++code) ASSERT_EQ(encode_depth(decode_depth<float>(int32_t(code))), code);
}

TEST(Layout, DepthIgnoresTheNormalBits) {
  EXPECT_EQ(decode_depth<float>(int32_t(0xffff0000u | 1234u)), decode_depth<float>(1234));
  const auto n = decode_normal<float>(int32_t(encode_normal({0.0f, 0.6f, -0.8f}) | 0xffffu));
  EXPECT_NEAR(n.y, 0.6f, 0.03f);
  EXPECT_NEAR(n.z, -0.8f, 0.03f);
}

TEST(Layout, NormalsAreUnitAndNear) {
  TestRandom random(21);
  // Codes are 2/255 apart along both axes of the square; half of that along both, stretched by up to sqrt(3) where the
  // octahedron's faces are nearest to the centre (radius 1 / sqrt(3)), and as much again across the slope of a face.
  constexpr float k_bound = 1.7320508f * 1.7320508f * 0.70710678f * (2.0f / 255.0f);
  const auto check = [&](const Vec3& n) {
    const auto d = decode_normal<float>(int32_t(encode_normal(n)));
    const Vec3 decoded(d.x, d.y, d.z);
    ASSERT_NEAR(glm::length(decoded), 1.0f, 1e-6f);
    ASSERT_LE(glm::length(decoded - n), k_bound) << n.x << " " << n.y << " " << n.z;
  };
  for (int i = 0; i < 200000; ++i) check(random.direction());
  for (int axis = 0; axis < 3; ++axis) {
    for (const float sign : {1.0f, -1.0f}) {
      Vec3 n(0.0f);
      n[axis] = sign;
      check(n);
      n[(axis + 1) % 3] = 1e-20f;
      check(n);
      n[(axis + 2) % 3] = -0.0f;
      check(n);
    }
  }
  for (uint32_t code = 0; code < 65536; ++code) {
    const auto d = decode_normal<float>(int32_t(code << 16));
    ASSERT_NEAR(d.x * d.x + d.y * d.y + d.z * d.z, 1.0f, 2e-6f) << code;
  }
}

TEST(Layout, ErrorBoundsAreMonotoneAndKept) {
  float before = 0.0f;
  for (uint32_t code = 0; code < 256; ++code) {
    const float e = decode_error<float>(int32_t(code << 8));
    ASSERT_GT(e, before);
    ASSERT_EQ(encode_error(e), code) << "an exact bound takes its own code";
    if (code > 0) {
      ASSERT_LE(e, before * 1.0626f) << "steps of at most 1/16";
    }
    before = e;
  }
  EXPECT_EQ(decode_error<float>(0), 0x1p-16f);
  EXPECT_EQ(decode_error<float>(255 << 8), 0x1p-1f * (1.0f + 15.0f / 16.0f));
  TestRandom random(22);
  for (int i = 0; i < 200000; ++i) {
    const float e = random.log_uniform(1e-7f, 0.96f);
    const float decoded = decode_error<float>(int32_t(encode_error(e) << 8));
    ASSERT_GE(decoded, e);
    ASSERT_LE(decoded, std::max(e * 1.0626f, 0x1p-16f));
  }
  EXPECT_EQ(encode_error(0.0f), 0u);
  EXPECT_EQ(encode_error(2.0f), 255u);
}

TEST(Layout, CertificateFieldsDoNotDisturbOneAnother) {
  for (const int kind : {scalar::k_kind_miss, scalar::k_kind_plane_fit, scalar::k_kind_one_sided}) {
    for (int risk = 0; risk <= 15; ++risk) {
      for (uint32_t error = 0; error < 256; error += 5) {
        const uint32_t c = encode_certificate(kind, risk, error);
        ASSERT_NE(c, 0u) << "0 means unknown";
        ASSERT_EQ(int(c & 3u), kind);
        ASSERT_EQ(int((c >> 2) & 63u), risk);
        ASSERT_EQ(decode_error<float>(int32_t(c)), decode_error<float>(int32_t(error << 8)));
      }
    }
  }
}

TEST(Layout, VisibilityCodesAreDistinct) {
  std::set<uint8_t> seen = {0};
  for (const bool hit : {false, true}) {
    for (int risk = 0; risk <= 15; ++risk) {
      const uint8_t code = encode_visibility(hit, risk);
      EXPECT_TRUE(seen.insert(code).second);
      EXPECT_EQ(((code - 1) & 1) == 1, hit);
      EXPECT_EQ((code - 1) >> 1, risk);
    }
  }
}

scalar::CellAddress<float> cell_at(int u, int v, int a, int b) {
  scalar::CellAddress<float> at{};
  at.u = u;
  at.v = v;
  at.a = a;
  at.b = b;
  return at;
}

TEST(Layout, SlicesNameTheirCells) {
  TestRandom random(23);
  for (const auto& [directions, plane] : {std::pair{32, 64}, {64, 128}, {256, 64}, {32, 512}, {256, 512}}) {
    Field field({Vec3(0.0f), 1.0f}, {.directions = directions, .plane = plane});
    const FieldView view = field.view();
    for (int i = 0; i < 20000; ++i) {
      const auto at = cell_at(int(random.index(uint32_t(directions))), int(random.index(uint32_t(directions))),
                              int(random.index(uint32_t(plane))), int(random.index(uint32_t(plane))));
      const auto slot = scalar::slot_of<float>(view, at);
      ASSERT_LT(uint32_t(slot.slice), field.slice_count());
      ASSERT_LT(slot.cell, scalar::k_brick_cells) << "nothing is stored yet";
      const SliceAddress s = field.slice_address(uint32_t(slot.slice));
      ASSERT_EQ(s.u, at.u);
      ASSERT_EQ(s.v, at.v);
      ASSERT_EQ(s.a0, at.a & ~3);
      ASSERT_EQ(s.b0, at.b & ~7);
    }
  }
}

TEST(Layout, EverySliceAddressIsReachedOnce) {
  Field field({Vec3(0.0f), 1.0f}, {.directions = 32, .plane = 64});
  std::set<std::tuple<int, int, int, int>> seen;
  for (uint32_t slice = 0; slice < field.slice_count(); ++slice) {
    const SliceAddress s = field.slice_address(slice);
    ASSERT_TRUE(seen.insert({s.u, s.v, s.a0, s.b0}).second);
    const auto slot = scalar::slot_of<float>(field.view(), cell_at(s.u, s.v, s.a0 + 3, s.b0 + 7));
    ASSERT_EQ(uint32_t(slot.slice), slice);
  }
}

TEST(Layout, SlotsOfClaimedSlicesAreDistinct) {
  // Claims slices of several bricks: each cell gets its own place, the one that claim() named.
  Field field({Vec3(0.0f), 1.0f}, {.directions = 32, .plane = 64});
  TestRandom random(24);
  std::set<int32_t> cells;
  for (int i = 0; i < 500; ++i) {
    const uint32_t slice = random.index(field.slice_count());
    const auto first = field.claim(FieldLayer::depth, slice);
    if (!first) continue;
    const SliceAddress s = field.slice_address(slice);
    for (int k = 0; k < scalar::k_slice_cells; ++k) {
      const auto slot = scalar::slot_of<float>(field.view(), cell_at(s.u, s.v, s.a0 + k / 8, s.b0 + k % 8));
      ASSERT_EQ(uint32_t(slot.cell), *first + uint32_t(k));
      ASSERT_GE(slot.cell, scalar::k_brick_cells) << "brick 0 stays empty";
      ASSERT_TRUE(cells.insert(slot.cell).second);
    }
    EXPECT_FALSE(field.claim(FieldLayer::depth, slice)) << "a slice is claimed once";
    EXPECT_FALSE(field.finished(FieldLayer::depth, slice));
    field.finish(FieldLayer::depth, slice);
    EXPECT_TRUE(field.finished(FieldLayer::depth, slice));
    EXPECT_FALSE(field.finished(FieldLayer::visibility, slice)) << "layers are baked apart";
  }
  EXPECT_GT(cells.size(), 10000u);
}

TEST(Layout, ParametersOutsideTheListsAreRefused) {
  const Sphere ball = {Vec3(0.0f), 1.0f};
  EXPECT_ANY_THROW(Field(ball, {.directions = 48}));
  EXPECT_ANY_THROW(Field(ball, {.directions = 16}));
  EXPECT_ANY_THROW(Field(ball, {.plane = 1024}));
  EXPECT_ANY_THROW(Field(ball, {.plane = 100}));
  EXPECT_ANY_THROW(Field(ball, {.lines = 3}));
  EXPECT_ANY_THROW(Field(ball, {.lines = k_max_lines + 1}));
}

}  // namespace
}  // namespace fieldtrace
