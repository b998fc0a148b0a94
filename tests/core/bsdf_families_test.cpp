// Dielectrics, plastics, principled and masks: sampling against density, energy, reciprocity, extreme parameters.

#include <gtest/gtest.h>

#include "core/material/fresnel.h"
#include "tests/support/bsdf_checks.h"
#include "tests/support/chi_square.h"

namespace fieldtrace {
namespace {

using namespace test;

// With about 60 tests, 4.5 deviations are exceeded by chance in fewer than 1 in 4,000 runs (and seeds are fixed).
constexpr double k_deviations = 4.5;

struct Named {
  const char* name;
  Material material;
};

std::vector<Named> opaque_materials() {
  constexpr MicrofacetKind ggx = MicrofacetKind::ggx, beckmann = MicrofacetKind::beckmann;
  return {{"plastic", plastic(0.5f, 1.49f)},
          {"nonlinear plastic", plastic(0.8f, 1.9f, true)},
          {"rough plastic ggx .3", rough_plastic(ggx, 0.3f, 0.5f, 1.49f)},
          {"rough plastic beckmann .15", rough_plastic(beckmann, 0.15f, 0.8f, 1.7f)},
          {"rough plastic beckmann .7", rough_plastic(beckmann, 0.7f, 0.2f, 1.3f)},
          {"principled", principled(0.5f, 0.5f, 0.0f, 0.0f)},
          {"principled metal", principled(0.8f, 0.6f, 1.0f, 0.0f)},
          {"principled coat", principled(0.4f, 0.7f, 0.3f, 1.0f)},
          {"masked rough plastic", masked(rough_plastic(ggx, 0.4f, 0.5f, 1.5f), 0.6f)},
          {"masked diffuse", masked(diffuse(0.9f), 0.25f)}};
}

// A plastic is its body and its interface: in the mean over the hemisphere, and nearly so in each direction.
TEST(CoatedBodies, AreWhatInterfacesLeave) {
  for (const Named& named : opaque_materials()) {
    if (!named.material.coated_diffuse()) continue;
    for (const float z : {0.05f, 0.4f, 0.8f, 1.0f}) {
      const Vec3 wi = direction(z, 0.3f);
      const CoatedBody body = coated_body(named.material, wi.z);
      const Material interface = without_body(named.material);
      double all = 0.0, by_body = 0.0;
      constexpr int k_side = 64;
      for (int i = 0; i < k_side * k_side; ++i) {
        const float cosine = std::sqrt((float(i / k_side) + 0.5f) / float(k_side));
        const Vec3 wo = direction(cosine, 2.0f * k_pi * (float(i % k_side) + 0.5f) / float(k_side));
        const double left =
            double((evaluate_bsdf(named.material, wi, wo) - evaluate_bsdf(interface, wi, wo)).y) / double(cosine);
        ASSERT_NEAR(double(body.reflected.y * relative_transmittance(named.material, cosine)), left,
                    1e-3 * double(body.reflected.y))
            << named.name << " " << z << " " << cosine;
        const double passed = 1.0 - double(body.grazing) * std::pow(1.0 - double(cosine), 5.0);
        const double estimate = double(body.reflected.y) * passed;
        all += left, by_body += estimate;
        ASSERT_NEAR(estimate * cosine, left * cosine, 0.04 * double(body.reflected.y))
            << named.name << " " << z << " " << cosine;
      }
      EXPECT_GT(all, 0.0);
      EXPECT_NEAR(by_body / all, 1.0, 2e-3) << named.name << " " << z;
    }
  }
}

// Interfaces that the fit is not for are left to samples.
TEST(CoatedBodies, AreOnlyThoseThatAreFitted) {
  constexpr MicrofacetKind ggx = MicrofacetKind::ggx, beckmann = MicrofacetKind::beckmann;
  EXPECT_TRUE(rough_plastic(ggx, 0.4f, 0.5f, 1.49f).coated_diffuse());
  EXPECT_TRUE(rough_plastic(beckmann, 1.0f, 0.5f, 1.49f).coated_diffuse());
  EXPECT_TRUE(plastic(0.5f, 1.0f, false).coated_diffuse());
  EXPECT_FALSE(rough_plastic(ggx, 0.7f, 0.5f, 1.49f).coated_diffuse());
  EXPECT_FALSE(rough_plastic(ggx, 1.0f, 0.5f, 1.3f).coated_diffuse());
  EXPECT_FALSE(rough_plastic(beckmann, 0.1f, 0.5f, 0.9f).coated_diffuse());
  EXPECT_FALSE(plastic(0.5f, 0.9f, false).coated_diffuse());
}

std::vector<Named> rough_dielectrics() {
  constexpr MicrofacetKind ggx = MicrofacetKind::ggx, beckmann = MicrofacetKind::beckmann;
  return {{"ggx .4", rough_glass(ggx, 0.4f, 0.4f, 1.5f)},
          {"ggx .2 x .6", rough_glass(ggx, 0.2f, 0.6f, 1.8f)},
          {"beckmann .5", rough_glass(beckmann, 0.5f, 0.5f, 1.33f)},
          {"beckmann .8 x .3", rough_glass(beckmann, 0.8f, 0.3f, 2.4f)},
          {"ggx .5, thinner inside", rough_glass(ggx, 0.5f, 0.5f, 0.7f)},
          {"masked ggx .3", masked(rough_glass(ggx, 0.3f, 0.3f, 1.5f), 0.5f)}};
}

std::vector<Named> all_materials() {
  std::vector<Named> all = opaque_materials();
  for (const Named& m : rough_dielectrics()) all.push_back(m);
  return all;
}

void expect_samples_follow_density(const Named& named, const Vec3& wi, Random& random) {
  const Material& m = named.material;
  SphereHistogram observed, expected;
  constexpr int n = 60000;
  for (int i = 0; i < n; ++i) {
    const BsdfSample s = sample_bsdf(m, wi, random.pair(), random());
    if (s.pdf > 0.0f && !s.delta) observed.add(s.wo);
  }
  expected.integrate([&](const Vec3& wo) { return bsdf_pdf(m, wi, wo); }, n, 24);
  EXPECT_LT(chi_square_deviation(observed.cells, expected.cells), k_deviations) << named.name << " cos " << wi.z;
}

TEST(OpaqueBsdf, SamplesFollowTheDensity) {
  Random random(21);
  for (const Named& m : opaque_materials()) {
    for (const float cos_theta : {0.99f, 0.6f, 0.15f}) {
      expect_samples_follow_density(m, direction(cos_theta, 0.9f), random);
    }
  }
}

TEST(RoughDielectric, SamplesFollowTheDensityFromBothSides) {
  Random random(22);
  for (const Named& m : rough_dielectrics()) {
    for (const float cos_theta : {0.99f, 0.6f, 0.15f, -0.2f, -0.7f, -0.95f}) {
      expect_samples_follow_density(m, direction(cos_theta, 2.3f), random);
    }
  }
}

TEST(Bsdf, WeightIsValueOverDensityForAllFamilies) {
  Random random(23);
  for (const Named& named : all_materials()) {
    const Material& m = named.material;
    int compared = 0;
    for (int i = 0; i < 2000; ++i) {
      Vec3 wi = random.upper();
      if (m.transmits() && i % 2) wi.z = -wi.z;
      const BsdfSample s = sample_bsdf(m, wi, random.pair(), random());
      if (!(s.pdf > 0.0f) || s.delta) continue;
      ++compared;
      // The half vector is recomputed from rounded directions: grazing angles lose digits in proportion.
      const float tolerance = 1e-5f / std::min(std::abs(wi.z), std::abs(s.wo.z)) + 3e-3f;
      EXPECT_NEAR(bsdf_pdf(m, wi, s.wo), s.pdf, tolerance * s.pdf) << named.name << " " << wi.z << " " << s.wo.z;
      const Rgb value = evaluate_bsdf(m, wi, s.wo);
      EXPECT_NEAR(value.x / s.pdf, s.weight.x, tolerance * std::max(s.weight.x, 1.0f))
          << named.name << " " << wi.z << " " << s.wo.z;
    }
    EXPECT_GT(compared, 300) << named.name;
  }
}

TEST(Bsdf, ReflectionIsReciprocalForAllFamilies) {
  Random random(24);
  for (const Named& named : all_materials()) {
    // The clearcoat follows Mitsuba, which multiplies by |cos wo| but not by 1 / (4 cos cos): reciprocal too.
    for (int i = 0; i < 1000; ++i) {
      Vec3 a = random.upper(), b = random.upper();
      if (named.material.transmits() && i % 2) a.z = -a.z, b.z = -b.z;
      const float forward = evaluate_bsdf(named.material, a, b).x / std::abs(b.z);
      const float backward = evaluate_bsdf(named.material, b, a).x / std::abs(a.z);
      EXPECT_NEAR(forward, backward, 2e-4f * std::max(forward, 1e-6f)) << named.name << " " << a.z << " " << b.z;
    }
  }
}

// Radiance over the squared index is conserved across an interface (Veach 1997, equation 5.14).
TEST(RoughDielectric, TransmissionIsReciprocalUpToTheIndex) {
  Random random(25);
  for (const Named& named : rough_dielectrics()) {
    const Material& m = named.material;
    const float eta2 = m.relative_ior * m.relative_ior;
    int positive = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3 above = random.upper(), below = -random.upper();
      const float in = evaluate_bsdf(m, above, below).x / std::abs(below.z);
      const float out = evaluate_bsdf(m, below, above).x / above.z;
      positive += in > 0.0f;
      // Where facets are seen edge-on, wi.m is a difference of nearly equal numbers.
      EXPECT_NEAR(in * eta2, out, 3e-3f * std::max(out, 1e-2f)) << named.name;
    }
    EXPECT_GT(positive, 200) << named.name;
  }
}

TEST(Bsdf, NoFamilyCreatesEnergy) {
  Random random(26);
  for (const Named& named : all_materials()) {
    // Burley's diffuse lobe and clearcoat are added to the specular lobe without energy compensation.
    if (named.material.kind == BsdfKind::principled) continue;
    for (const float cos_theta : {1.0f, 0.7f, 0.3f, 0.05f}) {
      constexpr int n = 20000;
      // Weights are at most about 3, so the mean's standard error is below 0.02 at worst, mostly 0.003.
      EXPECT_LE(mean_flux(named.material, direction(cos_theta, 0.3f), random, n), 1.015)
          << named.name << " " << cos_theta;
    }
  }
}

// A white body under a clear interface reflects all light; the fits of diffuse reflectance are accurate to 0.01.
TEST(Plastic, WhiteReturnsAllLight) {
  Random random(27);
  for (const float ior : {1.3f, 1.49f, 1.8f}) {
    for (const bool nonlinear : {false, true}) {
      for (const float cos_theta : {1.0f, 0.6f, 0.2f}) {
        const double albedo = mean_flux(plastic(1.0f, ior, nonlinear), direction(cos_theta, 0.3f), random, 40000);
        EXPECT_NEAR(albedo, 1.0, 0.02) << ior << " " << cos_theta;
      }
    }
  }
}

// Low roughness approaches the smooth interface, which loses nothing.
TEST(RoughDielectric, AlmostSmoothLosesNothing) {
  Random random(29);
  for (const float cos_theta : {0.8f, -0.9f}) {
    const Material m = rough_glass(MicrofacetKind::beckmann, 0.01f, 0.01f, 1.5f);
    EXPECT_NEAR(mean_flux(m, direction(cos_theta, 0.3f), random, 4000), 1.0, 1e-3);
  }
}

TEST(RoughDielectric, SmallRoughnessRefractsByTheSmoothLaw) {
  Random random(30);
  for (const float ior : {1.5f, 0.6f}) {
    const Material rough_one = rough_glass(MicrofacetKind::ggx, k_min_alpha, k_min_alpha, ior), smooth = glass(ior);
    for (int i = 0; i < 200; ++i) {
      Vec3 wi = random.upper();
      wi.z = std::max(wi.z, 0.1f) * (i % 2 ? -1.0f : 1.0f);
      wi = glm::normalize(wi);
      const float u = i % 3 == 0 ? 0.0f : 1.0f - 0x1p-24f;
      const BsdfSample a = sample_bsdf(rough_one, wi, Vec2(0.5f), u), b = sample_bsdf(smooth, wi, Vec2(0.5f), u);
      EXPECT_NEAR(a.eta, b.eta, 1e-6f);
      // Slopes are a few alpha; near the critical angle they are magnified.
      EXPECT_LT(glm::length(a.wo - b.wo), 0.05f) << wi.z;
      EXPECT_NEAR(a.weight.x, b.weight.x, 1e-3f);
    }
  }
}

TEST(ThinDielectric, SumsTheReflectionsBetweenItsFaces) {
  Random random(31);
  const Material m = thin_glass(1.5f);
  EXPECT_TRUE(m.delta());
  EXPECT_TRUE(m.transmits());
  for (const float z : {1.0f, 0.7f, 0.2f, -0.4f}) {
    const Vec3 wi = direction(z, 0.4f);
    const double r = fresnel_dielectric(std::abs(z), 1.5f).reflectance;
    // R + T^2 R (1 + R^2 + R^4 + ...), T = 1 - R.
    double expected = r, passage = (1.0 - r) * (1.0 - r) * r;
    for (int i = 0; i < 60; ++i, passage *= r * r) expected += passage;
    const BsdfSample through = sample_bsdf(m, wi, Vec2(0.5f), 1.0f - 0x1p-24f);
    EXPECT_EQ(through.wo, -wi);
    EXPECT_TRUE(through.straight && through.delta);
    EXPECT_EQ(through.weight.x, 1.0f);
    EXPECT_EQ(through.eta, 1.0f);
    EXPECT_NEAR(1.0 - through.pdf, expected, 1e-6);
    const BsdfSample back = sample_bsdf(m, wi, Vec2(0.5f), 0.0f);
    EXPECT_EQ(back.wo, Vec3(-wi.x, -wi.y, wi.z));
    EXPECT_FALSE(back.straight);
    EXPECT_NEAR(back.pdf, expected, 1e-6);
  }
}

TEST(Mask, PassesStraightOnByItsTransparency) {
  Random random(32);
  const Vec3 wi = direction(0.4f, 1.0f);
  const Material m = masked(diffuse(0.8f), 0.3f);
  int straight = 0;
  constexpr int n = 20000;
  for (int i = 0; i < n; ++i) {
    const BsdfSample s = sample_bsdf(m, wi, random.pair(), random());
    if (!s.straight) {
      EXPECT_EQ(s.weight.x, 0.8f);
      EXPECT_FLOAT_EQ(s.pdf, 0.3f * s.wo.z / k_pi);
      continue;
    }
    ++straight;
    EXPECT_EQ(s.wo, -wi);
    EXPECT_EQ(s.weight.x, 1.0f);
    EXPECT_FLOAT_EQ(s.pdf, 0.7f);
    EXPECT_TRUE(s.delta);
  }
  EXPECT_NEAR(straight, 0.7 * n, 5.0 * std::sqrt(0.21 * n));
  // From behind, only the mask's straight passage remains.
  for (int i = 0; i < 100; ++i) {
    const BsdfSample s = sample_bsdf(m, -wi, random.pair(), random());
    EXPECT_TRUE(s.straight || s.weight.x == 0.0f);
  }
  EXPECT_EQ(evaluate_bsdf(m, -wi, -wi).x, 0.0f);
  EXPECT_FALSE(m.plain_diffuse());
  EXPECT_TRUE(masked(m, 1.0f).plain_diffuse());
}

TEST(Mask, DarkSurfacesLetLightThroughOnlyWhereTheyAreMasked) {
  Scene scene;
  scene.textures.resize(2);
  scene.textures[1].color0 = Rgb(0.2f, 0.5f, 0.5f);
  scene.bsdfs.resize(2);
  scene.bsdfs[1].opacity = 1;
  const Material opaque = resolve_material(scene, 0, {}, -0.5f), open = resolve_material(scene, 1, {}, -0.5f);
  EXPECT_TRUE(opaque.absorbs());
  EXPECT_TRUE(open.dark && !open.absorbs());
  EXPECT_FLOAT_EQ(open.opacity, 0.4f);  // the mean
  EXPECT_EQ(material_albedo(open).x, 0.0f);
  EXPECT_FLOAT_EQ(material_albedo(resolve_material(scene, 1, {}, 0.5f)).x, 0.2f);
}

TEST(Bsdf, LobeAlphaIsTheNarrowestLobes) {
  EXPECT_EQ(lobe_alpha(diffuse(0.5f)), k_diffuse_alpha);
  EXPECT_EQ(lobe_alpha(glass(1.5f)), 0.0f);
  EXPECT_EQ(lobe_alpha(thin_glass(1.5f)), 0.0f);
  EXPECT_EQ(lobe_alpha(plastic(0.5f, 1.5f)), 0.0f);
  EXPECT_FLOAT_EQ(lobe_alpha(rough(MicrofacetKind::ggx, 0.1f, 0.4f)), 0.1f);
  EXPECT_FLOAT_EQ(lobe_alpha(rough(MicrofacetKind::ggx, 0.4f, 0.1f)), 0.1f);
  EXPECT_FLOAT_EQ(lobe_alpha(rough_glass(MicrofacetKind::ggx, 0.3f, 0.3f, 1.5f)), 0.3f);
  EXPECT_FLOAT_EQ(lobe_alpha(principled(0.5f, 0.5f, 0.0f, 0.0f)), 0.25f);
  const Material coated = principled(0.5f, 0.5f, 0.0f, 1.0f);
  EXPECT_LT(coated.clearcoat_alpha, 0.25f);
  EXPECT_EQ(lobe_alpha(coated), coated.clearcoat_alpha);
  EXPECT_EQ(lobe_alpha(masked(diffuse(0.5f), 0.5f)), k_diffuse_alpha);
}

TEST(Bsdf, AllFamiliesStayFiniteAtTheExtremes) {
  Random random(33);
  std::vector<Named> materials = all_materials();
  for (const MicrofacetKind kind : {MicrofacetKind::ggx, MicrofacetKind::beckmann}) {
    for (const float alpha : {k_min_alpha, 10.0f}) {
      materials.push_back({"rough plastic", rough_plastic(kind, alpha, 1.0f, 1.5f)});
      for (const float ior : {1.001f, 0.5f, 3.0f, 1.0f}) {
        materials.push_back({"rough glass", rough_glass(kind, alpha, k_min_alpha, ior)});
      }
    }
  }
  materials.push_back({"black plastic", plastic(0.0f, 1.5f)});
  materials.back().material.reflectance = Rgb(0.0f);
  materials.push_back({"thin", thin_glass(1.5f)});
  materials.push_back({"sharp principled", principled(1.0f, 0.0317f, 0.5f, 1.0f)});
  for (const Named& named : materials) {
    const Material& m = named.material;
    for (const float z : {0x1p-120f, 1e-20f, 1e-8f, 1e-3f, 1.0f - 0x1p-24f, 1.0f}) {
      for (int i = 0; i < 60; ++i) {
        Vec3 wi = glm::normalize(direction(z, 2.0f * k_pi * random()));
        if (i % 2) wi = -wi;
        Vec2 u = random.pair();
        if (i < 2) u = {0.0f, 0.0f};
        if (i == 2 || i == 3) u = Vec2(1.0f - 0x1p-24f);
        const BsdfSample s = sample_bsdf(m, wi, u, i < 4 ? 1.0f - 0x1p-24f : random());
        ASSERT_TRUE(std::isfinite(s.pdf) && s.pdf >= 0.0f) << named.name << " " << z;
        for (int c = 0; c < 3; ++c) {
          ASSERT_TRUE(std::isfinite(s.weight[c]) && s.weight[c] >= 0.0f) << named.name << " " << z;
          ASSERT_TRUE(std::isfinite(s.wo[c])) << named.name << " " << z;
        }
        Vec3 wo = random.upper();
        if (i % 4 < 2) wo = -wo;
        for (const Vec3& w : {wo, -wi, wi}) {
          ASSERT_TRUE(std::isfinite(evaluate_bsdf(m, wi, w).x)) << named.name << " " << z;
          ASSERT_TRUE(std::isfinite(bsdf_pdf(m, wi, w))) << named.name << " " << z;
        }
      }
    }
  }
}

// Rounding must not leave a little: `principled` has no lobe at all then.
TEST(Fresnel, OfEqualIndicesReflectsNothing) {
  for (int i = -1000; i <= 1000; ++i) {
    const float cosine = float(i) / 1000.0f;
    const DielectricFresnel f = fresnel_dielectric(cosine, 1.0f);
    EXPECT_EQ(f.reflectance, 0.0f) << cosine;
    EXPECT_EQ(f.cos_transmitted, -cosine);
  }
  Material m = principled(0.8f, 0.5f, 1.0f, 0.0f);
  m.relative_ior = 1.0f;
  for (const float z : {0.05f, 0.2f, 0.5f, 0.9f}) {
    const Vec3 wi(std::sqrt(1.0f - z * z), 0.0f, z);
    EXPECT_EQ(evaluate_bsdf(m, wi, {-wi.x, 0.0f, z}), Rgb(0.0f)) << z;
  }
}

// The integrals that the fits approximate, by the midpoint rule.
TEST(Fresnel, DiffuseReflectanceIsTheMeanOverCosines) {
  for (const float eta : {0.45f, 0.55f, 0.67f, 0.8f, 0.95f, 1.05f, 1.3f, 1.5f, 1.9f, 2.4f}) {
    double sum = 0.0;
    constexpr int n = 4000;
    for (int i = 0; i < n; ++i) {
      const double c = (i + 0.5) / n;
      sum += 2.0 * c * fresnel_dielectric(float(c), eta).reflectance / n;
    }
    EXPECT_NEAR(fresnel_diffuse_reflectance(eta), sum, 0.01) << eta;
  }
}

TEST(RoughTransmittance, TendsToTheSmoothInterface) {
  const RoughTransmittance table = make_rough_transmittance({MicrofacetKind::ggx, 0.002f, 0.002f}, 1.5f);
  for (const float c : {1.0f, 0.7f, 0.4f}) {
    EXPECT_NEAR(transmittance_at(table, c), 1.0f - fresnel_dielectric(c, 1.5f).reflectance, 2e-3f) << c;
  }
  EXPECT_NEAR(table.internal_reflectance, fresnel_diffuse_reflectance(1.0f / 1.5f), 0.01f);
}

}  // namespace
}  // namespace fieldtrace
