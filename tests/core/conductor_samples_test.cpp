// Rough metals sampled in SIMD lanes: bit-identical to single samples, with a Fresnel term that holds in single
// precision.
#include "core/material/conductor_samples.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/material/conductor.hd.h"
#include "core/material/fresnel.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

Material metal(float alpha_u, float alpha_v) {
  Material m;
  m.kind = BsdfKind::rough_conductor;
  m.microfacet = {MicrofacetKind::ggx, alpha_u, alpha_v};
  m.reflectance = Rgb(0.9f, 0.5f, 0.7f);
  m.eta = Rgb(1.66f, 0.88f, 0.52f);
  m.k = Rgb(9.2f, 6.3f, 4.8f);
  return m;
}

TEST(ConductorSamples, AreThoseOfSingleSamplesOnEveryMachine) {
  TestRandom random(11);
  int valid = 0;
  for (int probe = 0; probe < 200; ++probe) {
    const Material m = metal(random.log_uniform(k_min_alpha, 1.0f), random.log_uniform(k_min_alpha, 1.0f));
    const Frame frame = frame_about(random.direction());
    Vec3 wi = random.direction();
    wi.z = std::abs(wi.z);
    if (probe % 10 == 0) wi = Vec3(0.0f, 0.0f, 1.0f);
    if (probe % 10 == 1) wi = glm::normalize(Vec3(1.0f, 0.5f, 1e-4f));
    const uint32_t seed = random.index(1u << 31), first = random.index(1u << 20);
    const int count = 1 + int(random.index(70));
    for (const Isa isa : supported_isas()) {
      LobeSamples samples;
      sample_conductor(m, frame, wi, seed, first, count, isa, samples);
      for (int i = 0; i < count; ++i) {
        const auto u = scalar::sample_2d(first + uint32_t(i), seed, 0);
        const BsdfSample expected = sample_bsdf(m, wi, {u.x, u.y}, 0.0f);
        ASSERT_EQ(samples.pdf[size_t(i)], expected.pdf) << isa_name(isa);
        if (expected.pdf == 0.0f) continue;
        ++valid;
        ASSERT_EQ(samples.direction(size_t(i)), frame.to_world(expected.wo)) << isa_name(isa);
        ASSERT_EQ(samples.weight(size_t(i)), expected.weight) << isa_name(isa);
      }
    }
  }
  EXPECT_GT(valid, 3000);
}

// A sample's density equals the density evaluated for its direction.
TEST(ConductorSamples, DensitiesAreThoseOfTheirDirections) {
  TestRandom random(12);
  int valid = 0;
  for (int probe = 0; probe < 200; ++probe) {
    const Material m = metal(random.log_uniform(1e-2f, 1.0f), random.log_uniform(1e-2f, 1.0f));
    Vec3 wi = random.direction();
    wi.z = std::abs(wi.z);
    LobeSamples samples;
    sample_conductor(m, Frame(), wi, 5, 0, 64, Isa::automatic, samples);
    for (size_t i = 0; i < 64; ++i) {
      if (samples.pdf[i] == 0.0f) continue;
      ++valid;
      const Vec3 wo = samples.direction(i);
      const float pdf = bsdf_pdf(m, wi, wo);
      EXPECT_NEAR(samples.pdf[i], pdf, 2e-3f * pdf);
      const Rgb value = evaluate_bsdf(m, wi, wo) / pdf;
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(samples.weight(i)[c], value[c], 1e-3f * value[c] + 1e-6f);
    }
  }
  EXPECT_GT(valid, 6000);
}

// Born and Wolf's formulas as printed, in double precision.
double reflectance_in_double(double c, double eta, double k) {
  const double s2 = 1.0 - c * c, t = eta * eta - k * k - s2;
  const double squares = std::sqrt(t * t + 4.0 * eta * eta * k * k);
  const double a = std::sqrt(std::max(0.5 * (squares + t), 0.0));
  const double rs = (squares + c * c - 2.0 * a * c) / (squares + c * c + 2.0 * a * c);
  const double rp =
      rs * (c * c * squares + s2 * s2 - 2.0 * a * c * s2) / (c * c * squares + s2 * s2 + 2.0 * a * c * s2);
  return 0.5 * (rs + rp);
}

TEST(ConductorReflectance, HoldsInSinglePrecision) {
  TestRandom random(13);
  for (int probe = 0; probe < 200000; ++probe) {
    const float c = probe % 5 == 0 ? random.log_uniform(1e-4f, 1.0f) : random.uniform(0.0f, 1.0f);
    const float eta = random.log_uniform(0.02f, 20.0f), k = random.log_uniform(1e-3f, 50.0f);
    const double expected = reflectance_in_double(c, eta, k);
    const double bound = k >= 0.1f ? 0x1p-20 : 0x1p-14;
    ASSERT_NEAR(scalar::conductor_reflectance<float>(c, eta, k), expected, bound) << c << " " << eta << " " << k;
  }
  EXPECT_EQ(scalar::conductor_reflectance<float>(0.0f, 0.2f, 3.0f), 1.0f);
  EXPECT_EQ(scalar::conductor_reflectance<float>(0.5f, 0.0f, 0.0f), 1.0f);  // no transmission
  EXPECT_EQ(scalar::conductor_reflectance<float>(1.0f, 1.0f, 0.0f), 0.0f);  // no interface
}

}  // namespace
}  // namespace fieldtrace
