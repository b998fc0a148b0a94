// Materials: sampling against density, energy, reciprocity, Fresnel, extreme parameters.

#include "core/material/bsdf.h"

#include <gtest/gtest.h>

#include "core/material/fresnel.h"
#include "tests/support/bsdf_checks.h"
#include "tests/support/chi_square.h"

namespace fieldtrace {
namespace {

using namespace test;

// With 40 tests, 4.5 deviations are exceeded by chance in fewer than 1 in 5,000 runs (and seeds are fixed).
constexpr double k_deviations = 4.5;

std::vector<Material> smooth_density_materials() {
  return {diffuse(0.7f),
          rough(MicrofacetKind::ggx, 0.3f, 0.3f),
          rough(MicrofacetKind::ggx, 0.15f, 0.6f),
          rough(MicrofacetKind::ggx, 1.0f, 0.5f),
          rough(MicrofacetKind::beckmann, 0.3f, 0.3f),
          rough(MicrofacetKind::beckmann, 0.6f, 0.2f),
          rough(MicrofacetKind::beckmann, 1.0f, 1.0f)};
}

TEST(Bsdf, SamplesFollowTheDensity) {
  Random random(11);
  for (const Material& m : smooth_density_materials()) {
    for (const float cos_theta : {0.99f, 0.6f, 0.15f}) {
      const Vec3 wi = direction(cos_theta, 0.9f);
      SphereHistogram observed, expected;
      constexpr int n = 60000;
      for (int i = 0; i < n; ++i) {
        const BsdfSample s = sample_bsdf(m, wi, random.pair(), 0.0f);
        if (s.pdf > 0.0f) observed.add(s.wo);
      }
      expected.integrate([&](const Vec3& wo) { return bsdf_pdf(m, wi, wo); }, n, 12);
      EXPECT_LT(chi_square_deviation(observed.cells, expected.cells), k_deviations)
          << "kind " << int(m.kind) << " alpha " << m.microfacet.alpha_u << " " << m.microfacet.alpha_v << " cos "
          << cos_theta;
    }
  }
}

TEST(Bsdf, VisibleNormalsFollowTheirDensity) {
  Random random(12);
  for (const MicrofacetKind kind : {MicrofacetKind::ggx, MicrofacetKind::beckmann}) {
    for (const float cos_theta : {0.9f, 0.3f, 0.05f}) {
      const Microfacet f{kind, 0.5f, 0.25f};
      const Vec3 wi = direction(cos_theta, 2.0f);
      SphereHistogram observed, expected;
      constexpr int n = 60000;
      for (int i = 0; i < n; ++i) observed.add(f.sample_visible(wi, random.pair()));
      expected.integrate([&](const Vec3& m) { return f.visible_pdf(wi, m); }, n, 32);
      double total = 0.0;
      for (const double e : expected.cells) total += e / n;
      EXPECT_NEAR(total, 1.0, 2e-3);  // the visible normals' density is normalised
      EXPECT_LT(chi_square_deviation(observed.cells, expected.cells), k_deviations) << int(kind) << " " << cos_theta;
    }
  }
}

TEST(Bsdf, MicrofacetAreaProjectsToOne) {
  for (const MicrofacetKind kind : {MicrofacetKind::ggx, MicrofacetKind::beckmann}) {
    for (const float alpha : {0.4f, 0.7f, 1.0f}) {
      const Microfacet f{kind, alpha, 0.5f * alpha};
      SphereHistogram h;
      h.integrate([&](const Vec3& m) { return f.d(m) * m.z; }, 1.0, 32);
      double total = 0.0;
      for (const double c : h.cells) total += c;
      EXPECT_NEAR(total, 1.0, 5e-3) << int(kind) << " " << alpha;
    }
  }
}

TEST(Bsdf, WeightIsValueOverDensity) {
  Random random(13);
  for (const Material& m : smooth_density_materials()) {
    int compared = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3 wi = random.upper();
      const BsdfSample s = sample_bsdf(m, wi, random.pair(), 0.0f);
      if (!(s.pdf > 0.0f)) continue;
      ++compared;
      // The half vector is computed anew from rounded directions: grazing angles lose digits in proportion.
      const float tolerance = 1e-3f / std::min(std::min(wi.z, s.wo.z), 1.0f) * 1e-2f + 2e-3f;
      const Rgb value = evaluate_bsdf(m, wi, s.wo);
      EXPECT_NEAR(value.x / s.pdf, s.weight.x, tolerance * std::max(s.weight.x, 1.0f)) << wi.z << " " << s.wo.z;
    }
    EXPECT_GT(compared, 1000);  // the others go below the horizon
  }
}

TEST(Bsdf, IsReciprocal) {
  Random random(14);
  for (const Material& m : smooth_density_materials()) {
    for (int i = 0; i < 2000; ++i) {
      const Vec3 a = random.upper(), b = random.upper();
      const float forward = evaluate_bsdf(m, a, b).x / b.z, backward = evaluate_bsdf(m, b, a).x / a.z;
      EXPECT_NEAR(forward, backward, 1e-4f * std::max(forward, 1e-6f));
    }
  }
}

TEST(Bsdf, NeverCreatesEnergy) {
  Random random(15);
  for (const Material& m : smooth_density_materials()) {
    for (const float cos_theta : {1.0f, 0.7f, 0.3f, 0.05f, 1e-3f}) {
      const Vec3 wi = direction(cos_theta, 0.3f);
      double sum = 0.0;
      constexpr int n = 5000;
      for (int i = 0; i < n; ++i) {
        const BsdfSample s = sample_bsdf(m, wi, random.pair(), 0.0f);
        EXPECT_LE(s.weight.x, 1.0f + gamma_bound(8));
        sum += s.weight.x;
      }
      EXPECT_LE(sum / n, 1.0 + gamma_bound(8));
    }
  }
}

// Directional albedo of a perfect reflector under single scattering. Values of Mitsuba 3.9, 20,000 samples each.
TEST(Bsdf, MicrofacetAlbedoAgreesWithReference) {
  struct Case {
    MicrofacetKind kind;
    float alpha, cos_theta, albedo;
  };
  const Case cases[] = {
      {MicrofacetKind::ggx, .1f, 1.0f, .9891f},     {MicrofacetKind::ggx, .1f, .7f, .9817f},
      {MicrofacetKind::ggx, .1f, .3f, .9364f},      {MicrofacetKind::ggx, .3f, 1.0f, .8799f},
      {MicrofacetKind::ggx, .3f, .7f, .8456f},      {MicrofacetKind::ggx, .3f, .3f, .8075f},
      {MicrofacetKind::beckmann, .1f, .3f, .9874f}, {MicrofacetKind::beckmann, .3f, 1.0f, .9996f},
      {MicrofacetKind::beckmann, .3f, .7f, .9676f}, {MicrofacetKind::beckmann, .3f, .3f, .9034f},
  };
  Random random(18);
  for (const Case& c : cases) {
    const Material m = rough(c.kind, c.alpha, c.alpha);
    double sum = 0.0;
    constexpr int n = 20000;
    for (int i = 0; i < n; ++i) sum += sample_bsdf(m, direction(c.cos_theta, 0.0f), random.pair(), 0.0f).weight.x;
    // Both values have a standard error below 0.0025.
    EXPECT_NEAR(sum / n, c.albedo, 0.01) << int(c.kind) << " " << c.alpha << " " << c.cos_theta;
  }
}

TEST(Bsdf, StaysFiniteAtTheExtremes) {
  Random random(16);
  for (const MicrofacetKind kind : {MicrofacetKind::ggx, MicrofacetKind::beckmann}) {
    for (const float alpha_u : {k_min_alpha, 1e-2f, 1.0f, 10.0f}) {
      for (const float alpha_v : {k_min_alpha, 1.0f}) {
        Material m = rough(kind, alpha_u, alpha_v);
        m.eta = Rgb(0.2f, 0.0f, 3.0f);
        m.k = Rgb(3.9f, 0.0f, 1e4f);
        for (const float z : {0x1p-120f, 1e-20f, 1e-8f, 1e-3f, 1.0f - 0x1p-24f, 1.0f}) {
          for (int i = 0; i < 50; ++i) {
            const Vec3 wi = glm::normalize(direction(z, 2.0f * k_pi * random()));
            Vec2 u = random.pair();
            if (i == 0) u = {0.0f, 0.0f};
            if (i == 1) u = Vec2(1.0f - 0x1p-24f);
            const BsdfSample s = sample_bsdf(m, wi, u, random());
            ASSERT_TRUE(std::isfinite(s.pdf) && s.pdf >= 0.0f) << z << " " << alpha_u;
            for (int c = 0; c < 3; ++c) {
              ASSERT_TRUE(std::isfinite(s.weight[c]) && s.weight[c] >= 0.0f) << z << " " << alpha_u;
              ASSERT_TRUE(std::isfinite(s.wo[c]));
            }
            const Vec3 wo = random.upper();
            ASSERT_TRUE(std::isfinite(evaluate_bsdf(m, wi, wo).x));
            ASSERT_TRUE(std::isfinite(bsdf_pdf(m, wi, wo)));
          }
        }
      }
    }
  }
}

TEST(Fresnel, DielectricKnownValues) {
  EXPECT_NEAR(fresnel_dielectric(1.0f, 1.5f).reflectance, 0.04f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(-1.0f, 1.5f).reflectance, 0.04f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(0.0f, 1.5f).reflectance, 1.0f, 1e-6f);
  // Values of an independent renderer for cos = 0.8, index 1.5.
  EXPECT_NEAR(fresnel_dielectric(0.8f, 1.5f).reflectance, 0.0438947f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(-0.8f, 1.5f).reflectance, 0.1141411f, 1e-6f);
  // Beyond the critical angle: sin > 1 / 1.5.
  EXPECT_EQ(fresnel_dielectric(-0.7f, 1.5f).reflectance, 1.0f);
  EXPECT_LT(fresnel_dielectric(-0.75f, 1.5f).reflectance, 1.0f);
  // At Brewster's angle only perpendicular polarisation is reflected: ((n^2 - 1) / (n^2 + 1))^2 / 2.
  const float brewster = std::cos(std::atan(1.5f));
  EXPECT_NEAR(fresnel_dielectric(brewster, 1.5f).reflectance, 0.5f * std::pow(1.25f / 3.25f, 2.0f), 1e-6f);
}

TEST(Fresnel, ReflectanceIsTheSameFromBothSides) {
  for (float c = 0.02f; c < 1.0f; c += 0.02f) {
    const DielectricFresnel in = fresnel_dielectric(c, 1.5f);
    EXPECT_NEAR(in.reflectance, fresnel_dielectric(in.cos_transmitted, 1.5f).reflectance, 1e-5f) << c;
  }
}

TEST(Fresnel, ConductorWithoutAbsorptionIsADielectric) {
  for (float c = 0.0f; c <= 1.0f; c += 0.05f) {
    EXPECT_NEAR(fresnel_conductor(c, Rgb(1.5f), Rgb(0.0f)).x, fresnel_dielectric(c, 1.5f).reflectance, 1e-6f) << c;
  }
}

TEST(Fresnel, PerfectMirrorReflectsAll) {
  for (float c = 0.0f; c <= 1.0f; c += 0.05f) EXPECT_NEAR(fresnel_conductor(c, Rgb(0.0f), Rgb(1.0f)).x, 1.0f, 1e-6f);
}

TEST(Bsdf, DielectricConservesFlux) {
  Random random(17);
  for (const float ior : {1.0f, 1.33f, 1.5f, 2.4f, 0.7f}) {
    const Material m = glass(ior);
    int reflected = 0, transmitted = 0;
    for (int i = 0; i < 500; ++i) {
      Vec3 wi = random.upper();
      if (i % 2) wi.z = -wi.z;
      for (const float u : {0.0f, 1.0f - 0x1p-24f}) {
        const BsdfSample s = sample_bsdf(m, wi, Vec2(0.5f), u);
        if (s.pdf == 0.0f) continue;
        EXPECT_TRUE(s.delta);
        EXPECT_NEAR(glm::length(s.wo), 1.0f, 1e-6f);
        const bool crossed = s.wo.z * wi.z < 0.0f;
        ++(crossed ? transmitted : reflected);
        // Radiance grows by the square of the index ratio on entering; flux does not.
        EXPECT_NEAR(s.weight.x * s.eta * s.eta, 1.0f, 1e-5f);
        if (!crossed) continue;
        // Snell: the ratio of the sines is the index of the far side, and the plane of incidence is kept.
        const float ratio = wi.z > 0.0f ? ior : 1.0f / ior;
        EXPECT_NEAR(s.eta, ratio, 1e-5f);
        EXPECT_NEAR(s.wo.x * ratio, -wi.x, 2e-5f);
        EXPECT_NEAR(s.wo.y * ratio, -wi.y, 2e-5f);
      }
    }
    EXPECT_GT(transmitted, 250);
    EXPECT_TRUE(reflected > 250 || ior == 1.0f) << ior;
  }
}

// Values of an independent renderer (Mitsuba 3.9, roughconductor, eta .2 .9 1.1, k 3.9 2.4 2.2, alpha .2 x .4).
TEST(Bsdf, RoughConductorAgreesWithReference) {
  Material m = rough(MicrofacetKind::ggx, 0.2f, 0.4f);
  m.eta = Rgb(0.2f, 0.9f, 1.1f);
  m.k = Rgb(3.9f, 2.4f, 2.2f);
  const Vec3 wi1(0.6f, 0.0f, 0.8f), wo1 = glm::normalize(Vec3(-0.5f, 0.2f, 0.84f));
  const Vec3 wi2 = glm::normalize(Vec3(0.3f, 0.5f, 0.8f)), wo2 = glm::normalize(Vec3(-0.2f, -0.1f, 0.9f));
  EXPECT_NEAR(evaluate_bsdf(m, wi1, wo1).x, 0.8657141f, 1e-5f);
  EXPECT_NEAR(evaluate_bsdf(m, wi1, wo1).z, 0.4778397f, 1e-5f);
  EXPECT_NEAR(bsdf_pdf(m, wi1, wo1), 0.9152496f, 1e-5f);
  EXPECT_NEAR(evaluate_bsdf(m, wi2, wo2).y, 0.4379934f, 1e-5f);
  EXPECT_NEAR(bsdf_pdf(m, wi2, wo2), 0.7120487f, 1e-5f);
  m.microfacet.kind = MicrofacetKind::beckmann;
  // Masking is a rational fit there (relative error up to 0.4 %), exact here.
  EXPECT_NEAR(evaluate_bsdf(m, wi1, wo1).x, 1.0210545f, 4e-3f);
  EXPECT_NEAR(bsdf_pdf(m, wi2, wo2), 0.9394979f, 4e-3f);
}

TEST(Bsdf, TwoSidedTakesTheBackMaterial) {
  Scene scene;
  scene.textures.resize(2);
  scene.textures[0].color0 = Rgb(0.25f);
  scene.textures[1].color0 = Rgb(0.75f);
  scene.bsdfs.resize(4);
  scene.bsdfs[1].reflectance = 1;
  scene.bsdfs[2].two_sided = true;  // the same on both sides
  scene.bsdfs[3].two_sided = true;
  scene.bsdfs[3].back = 1;
  EXPECT_FALSE(resolve_material(scene, 0, {}, 0.5f).dark);
  EXPECT_TRUE(resolve_material(scene, 0, {}, -0.5f).dark);
  EXPECT_FALSE(resolve_material(scene, 2, {}, -0.5f).dark);
  EXPECT_TRUE(resolve_material(scene, 2, {}, -0.5f).turned);
  EXPECT_EQ(resolve_material(scene, 2, {}, -0.5f).reflectance.x, 0.25f);
  EXPECT_EQ(resolve_material(scene, 3, {}, -0.5f).reflectance.x, 0.75f);
  EXPECT_EQ(resolve_material(scene, 3, {}, 0.5f).reflectance.x, 0.25f);
  EXPECT_FALSE(resolve_material(scene, 3, {}, 0.5f).turned);
}

}  // namespace
}  // namespace fieldtrace
