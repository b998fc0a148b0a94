// Rays of the caller as every instruction set makes batches of them.
#include "hybrid/api/ray_kernels.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace fieldtrace::api {
namespace {

// Rays with anything between them; `data` has exactly the bytes that belong to them, so that reading on is found out.
struct Rays {
  std::vector<float> data;
  size_t floats;  // from ray to ray
  size_t count;

  Rays(size_t n, size_t stride, uint32_t seed) : floats(stride), count(n) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> exponent(-8.0f, 8.0f), sign(-1.0f, 1.0f);
    const auto number = [&] { return std::copysign(std::pow(10.0f, exponent(random)), sign(random)); };
    data.resize(n ? (n - 1) * stride + 7 : 0);
    for (float& v : data) v = number();
  }
  float* origin(size_t i) { return &data[i * floats]; }
  float* direction(size_t i) { return origin(i) + 3; }
  float* t(size_t i) { return origin(i) + 6; }
  RaySource source(bool ends = true) const {
    const size_t bytes = floats * sizeof(float);
    const float* const p = data.data();
    return {p, bytes, p + 3, bytes, ends ? p + 6 : nullptr, bytes, {1e-4f, 1e12f}};
  }
};

std::vector<GatherKernel> kernels() {
  std::vector<GatherKernel> all;
  for (const Isa isa : supported_isas()) all.push_back(gather_kernel_for(isa));
  return all;
}

void expect_same(const RaySource& source, size_t count) {
  RayBatch expected, found;
  expected.resize(count);
  const RayExtent scalar = gather_rays_scalar(source, expected);
  for (const GatherKernel kernel : kernels()) {
    found.resize(count);
    const RayExtent extent = kernel(source, found);
    for (const auto member :
         {&RayBatch::ox, &RayBatch::oy, &RayBatch::oz, &RayBatch::dx, &RayBatch::dy, &RayBatch::dz, &RayBatch::tmax}) {
      for (size_t i = 0; i < padded(count); ++i)
        ASSERT_EQ(std::bit_cast<uint32_t>((found.*member)[i]), std::bit_cast<uint32_t>((expected.*member)[i])) << i;
    }
    EXPECT_EQ(extent.faulty, scalar.faulty);
    if (scalar.faulty) continue;
    EXPECT_EQ(extent.unbounded, scalar.unbounded);
    EXPECT_EQ(extent.uneven, scalar.uneven);
    EXPECT_EQ(extent.origins.lower, scalar.origins.lower);
    EXPECT_EQ(extent.origins.upper, scalar.origins.upper);
    if (scalar.unbounded) continue;
    EXPECT_EQ(extent.ends.lower, scalar.ends.lower);
    EXPECT_EQ(extent.ends.upper, scalar.ends.upper);
  }
}

TEST(RayKernels, AreThoseOfScalarCode) {
  for (size_t count = 0; count < 70; ++count) {
    for (const size_t stride : {7, 8, 11}) {
      const Rays rays(count, stride, uint32_t(100 * count + stride));
      expect_same(rays.source(), count);
      expect_same(rays.source(false), count);
    }
  }
}

TEST(RayKernels, PackedArraysAreThoseOfScalarCode) {
  for (size_t count = 0; count < 70; ++count) {
    Rays rays(3 * count, 7, uint32_t(count));
    const float* const p = rays.data.data();
    const RaySource packed = {p, 12, p + 3 * count, 12, p + 6 * count, 4, {}};
    expect_same(packed, count);
  }
}

TEST(RayKernels, EveryFaultIsFound) {
  const float infinite = std::numeric_limits<float>::infinity(), nan = std::nanf("");
  for (size_t count : {1, 5, 16, 33}) {
    for (size_t i = 0; i < count; ++i) {
      for (size_t part = 0; part < 7; ++part) {
        for (const float value : {infinite, -infinite, nan}) {
          Rays rays(count, 7, 1);
          rays.origin(i)[part] = value;
          const bool fault = part < 6 || std::isnan(value);
          for (const GatherKernel kernel : kernels()) {
            RayBatch batch;
            batch.resize(count);
            EXPECT_EQ(kernel(rays.source(), batch).faulty, fault) << i << " " << part << " " << value;
          }
          expect_same(rays.source(), count);
        }
      }
      Rays rays(count, 7, 2);
      rays.direction(i)[0] = rays.direction(i)[2] = 0.0f, rays.direction(i)[1] = -0.0f;
      for (const GatherKernel kernel : kernels()) {
        RayBatch batch;
        batch.resize(count);
        EXPECT_TRUE(kernel(rays.source(), batch).faulty);
      }
      expect_same(rays.source(), count);
    }
  }
}

TEST(RayKernels, RaysOfNegativeLengthBoundNothing) {
  for (const size_t count : {1, 40}) {
    Rays rays(count, 7, 3);
    for (size_t i = 0; i < count; ++i) *rays.t(i) = i == 0 ? 0.0f : -std::abs(*rays.t(i));
    for (const GatherKernel kernel : kernels()) {
      RayBatch batch;
      batch.resize(count);
      const RayExtent extent = kernel(rays.source(), batch);
      const Vec3 o(rays.origin(0)[0], rays.origin(0)[1], rays.origin(0)[2]);
      EXPECT_EQ(extent.origins.lower, o);
      EXPECT_EQ(extent.origins.upper, o);
      EXPECT_EQ(extent.ends.lower, o);
      EXPECT_FALSE(extent.unbounded);
    }
    *rays.t(0) = -1.0f;
    for (const GatherKernel kernel : kernels()) {
      RayBatch batch;
      batch.resize(count);
      EXPECT_TRUE(kernel(rays.source(), batch).origins.empty());
    }
  }
}

}  // namespace
}  // namespace fieldtrace::api
