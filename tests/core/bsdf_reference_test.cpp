// Materials of scene files against the values of another renderer.
//
// The values were printed by tests/scripts/material_values.py with Mitsuba 3.9.1, variant scalar_rgb.

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/bsdf_checks.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

// Polar angles and azimuths in degrees; value times cosine; density of sampling wo.
struct ReferenceRow {
  double theta_i, phi_i, theta_o, phi_o;
  float red, green, blue, pdf;
};
struct Reference {
  const char* xml;
  std::vector<ReferenceRow> rows;
};

// clang-format off
const std::vector<Reference> k_references = {
    {R"(<bsdf type="plastic">
        <rgb name="diffuse_reflectance" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0559691f, 0.139923f, 0.195892f, 0.253645f},
      {60, 40, 50, 200, 0.0387884f, 0.0969711f, 0.13576f, 0.169747f},
      {75, 10, 80, 190, 0.00559509f, 0.0139877f, 0.0195828f, 0.0321661f},
      {40, 0, 40, 60, 0.0490164f, 0.122541f, 0.171557f, 0.221793f}}},
    {R"(<bsdf type="plastic">
        <boolean name="nonlinear" value="true"/>
        <float name="int_ior" value="1.9"/>
        <rgb name="diffuse_reflectance" value="0.2, 0.5, 0.7"/>
        <rgb name="specular_reflectance" value="0.5"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0146947f, 0.0503487f, 0.0936119f, 0.247337f},
      {60, 40, 50, 200, 0.0100784f, 0.0345316f, 0.0642037f, 0.172453f},
      {75, 10, 80, 190, 0.00145585f, 0.0049882f, 0.00927442f, 0.037802f},
      {40, 0, 40, 60, 0.0128354f, 0.043978f, 0.081767f, 0.217123f}}},
    {R"(<bsdf type="roughplastic">
        <string name="distribution" value="ggx"/>
        <float name="alpha" value="0.3"/>
        <rgb name="diffuse_reflectance" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0685473f, 0.125344f, 0.163208f, 0.325666f},
      {60, 40, 50, 200, 0.0636694f, 0.101852f, 0.127306f, 0.290805f},
      {75, 10, 80, 190, 0.553482f, 0.561158f, 0.566275f, 0.950492f},
      {40, 0, 40, 60, 0.0347851f, 0.0837322f, 0.116364f, 0.220187f}}},
    {R"(<bsdf type="roughplastic">
        <float name="alpha" value="0.15"/>
        <boolean name="nonlinear" value="true"/>
        <float name="int_ior" value="1.7"/>
        <rgb name="diffuse_reflectance" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.191849f, 0.235046f, 0.282104f, 0.580948f},
      {60, 40, 50, 200, 0.0494059f, 0.0789048f, 0.11104f, 0.244784f},
      {75, 10, 80, 190, 4.23651f, 4.24127f, 4.24645f, 5.54507f},
      {40, 0, 40, 60, 0.0166835f, 0.0543656f, 0.0954149f, 0.207682f}}},
    {R"(<bsdf type="roughdielectric">
        <string name="distribution" value="ggx"/>
        <float name="alpha" value="0.4"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0194972f, 0.0194972f, 0.0194972f, 0.0197538f},
      {60, 40, 50, 200, 0.0317959f, 0.0317959f, 0.0317959f, 0.0335099f},
      {75, 10, 80, 190, 0.242171f, 0.242171f, 0.242171f, 0.421274f},
      {40, 0, 40, 60, 0.00316388f, 0.00316388f, 0.00316388f, 0.00325061f},
      {30, 0, 150, 180, 1.57954f, 1.57954f, 1.57954f, 3.62085f},
      {50, 90, 130, 260, 0.463473f, 0.463473f, 0.463473f, 1.10517f},
      {150, 20, 160, 210, 0.0235252f, 0.0235252f, 0.0235252f, 0.0236492f},
      {140, 0, 30, 180, 0.648307f, 0.648307f, 0.648307f, 0.290307f},
      {160, 0, 20, 160, 3.89164f, 3.89164f, 3.89164f, 1.72908f}}},
    {R"(<bsdf type="roughdielectric">
        <float name="alpha" value="0.3"/>
        <float name="int_ior" value="1.8"/>
        <rgb name="specular_transmittance" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0712584f, 0.0712584f, 0.0712584f, 0.0712584f},
      {60, 40, 50, 200, 0.104103f, 0.104103f, 0.104103f, 0.104103f},
      {75, 10, 80, 190, 0.986258f, 0.986258f, 0.986258f, 1.12449f},
      {40, 0, 40, 60, 0.000624062f, 0.000624062f, 0.000624062f, 0.000624062f},
      {30, 0, 150, 180, 0.0513924f, 0.128481f, 0.179873f, 0.832095f},
      {50, 90, 130, 260, 3.33322e-07f, 8.33304e-07f, 1.16663e-06f, 5.39682e-06f},
      {150, 20, 160, 210, 0.0939946f, 0.0939946f, 0.0939946f, 0.0939946f},
      {140, 0, 30, 180, 2.98382e-07f, 7.45956e-07f, 1.04434e-06f, 4.60722e-07f},
      {160, 0, 20, 160, 0.620756f, 1.55189f, 2.17265f, 0.958488f}}},
    {R"(<bsdf type="roughdielectric">
        <string name="distribution" value="ggx"/>
        <float name="alpha_u" value="0.2"/>
        <float name="alpha_v" value="0.5"/>
        <float name="int_ior" value="1"/>
        <float name="ext_ior" value="1.4"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0188758f, 0.0188758f, 0.0188758f, 0.0189484f},
      {60, 40, 50, 200, 0.928967f, 0.928967f, 0.928967f, 0.949796f},
      {75, 10, 80, 190, 1.91572f, 1.91572f, 1.91572f, 2.4694f},
      {40, 0, 40, 60, 0.000509188f, 0.000509188f, 0.000509188f, 0.000526314f},
      {30, 0, 150, 180, 0.88745f, 0.88745f, 0.88745f, 0.454285f},
      {50, 90, 130, 260, 1.53349f, 1.53349f, 1.53349f, 0.845065f},
      {150, 20, 160, 210, 0.0173514f, 0.0173514f, 0.0173514f, 0.0174044f},
      {140, 0, 30, 180, 7.94189f, 7.94189f, 7.94189f, 15.6178f},
      {160, 0, 20, 160, 1.78793f, 1.78793f, 1.78793f, 3.51182f}}},
    {R"(<bsdf type="principled">
        <rgb name="base_color" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.0974248f, 0.180125f, 0.235259f, 0.660392f},
      {60, 40, 50, 200, 0.081529f, 0.142567f, 0.18326f, 0.417185f},
      {75, 10, 80, 190, 0.90431f, 0.916609f, 0.924809f, 1.99168f},
      {40, 0, 40, 60, 0.0505051f, 0.123698f, 0.172493f, 0.143419f}}},
    {R"(<bsdf type="principled">
        <float name="roughness" value="0.3"/>
        <float name="metallic" value="0.6"/>
        <float name="specular" value="0.8"/>
        <rgb name="base_color" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.360514f, 0.811092f, 1.11148f, 1.73663f},
      {60, 40, 50, 200, 0.0562269f, 0.124301f, 0.169684f, 0.234734f},
      {75, 10, 80, 190, 9.08169f, 11.9906f, 13.9298f, 17.3738f},
      {40, 0, 40, 60, 0.0205011f, 0.0509901f, 0.0713162f, 0.0745433f}}},
    {R"(<bsdf type="principled">
        <float name="clearcoat" value="0.9"/>
        <float name="clearcoat_gloss" value="0.2"/>
        <float name="eta" value="1.6"/>
        <float name="anisotropic" value="0.7"/>
        <rgb name="base_color" value="0.2, 0.5, 0.7"/>
        </bsdf>)",
     {{20, 0, 30, 170, 0.14253f, 0.22523f, 0.280364f, 0.709594f},
      {60, 40, 50, 200, 0.0606816f, 0.12172f, 0.162412f, 0.209104f},
      {75, 10, 80, 190, 0.705077f, 0.717376f, 0.725576f, 2.4393f},
      {40, 0, 40, 60, 0.0524398f, 0.125632f, 0.174427f, 0.134143f}}},
    {R"(<bsdf type="mask">
        <float name="opacity" value="0.3"/>
        <bsdf type="roughconductor"/>
        </bsdf>)",
     {{20, 0, 30, 170, 1.02634f, 1.02634f, 1.02634f, 1.02634f},
      {60, 40, 50, 200, 0.00553931f, 0.00553931f, 0.00553931f, 0.00553931f},
      {75, 10, 80, 190, 7.65211f, 7.65211f, 7.65211f, 7.65211f}}},
};
// clang-format on

Vec3 at_degrees(double theta, double phi) {
  const double t = theta * M_PI / 180.0, p = phi * M_PI / 180.0;
  return Vec3(DVec3(std::sin(t) * std::cos(p), std::sin(t) * std::sin(p), std::cos(t)));
}

// Relative. Exact formulas agree to the six digits printed, except for the rounding of half vectors, which D magnifies
// by 1 / alpha^2 < 100. Beckmann masking is exact here and a rational fit in Mitsuba, off by up to 0.4 % for each of
// two directions; rough plastic's tables are computed by different quadratures, each accurate to about 1e-3, and enter
// twice.
float tolerance(const Material& m) {
  float result = 1e-4f;
  if (m.kind == BsdfKind::rough_plastic) result += 4e-3f;
  const bool is_rough = m.kind != BsdfKind::plastic && m.kind != BsdfKind::diffuse;
  if (is_rough && m.microfacet.kind == MicrofacetKind::beckmann) result += 8e-3f;
  return result;
}

class BsdfReference : public SceneFiles {};

TEST_F(BsdfReference, ValuesAndDensitiesAgreeWithMitsuba) {
  for (const Reference& reference : k_references) {
    const Scene scene = load(k_sensor + "<shape type=\"sphere\">" + reference.xml + "</shape>");
    for (const ReferenceRow& row : reference.rows) {
      const Vec3 wi = at_degrees(row.theta_i, row.phi_i), wo = at_degrees(row.theta_o, row.phi_o);
      const Material m = resolve_material(scene, scene.instances[0].bsdf, Vec2(0.5f), wi.z);
      const float relative = tolerance(m);
      const Rgb value = evaluate_bsdf(m, wi, wo), expected(row.red, row.green, row.blue);
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(value[c], expected[c], relative * expected[c])
            << reference.xml << " wi " << row.theta_i << " wo " << row.theta_o << " channel " << c;
      }
      EXPECT_NEAR(bsdf_pdf(m, wi, wo), row.pdf, relative * row.pdf)
          << reference.xml << " wi " << row.theta_i << " wo " << row.theta_o;
    }
  }
}

// Fraction of the arriving flux that white materials scatter, which is less than 1 for single scattering. Mitsuba
// 3.9.1, 100,000 samples each (standard error at most 0.0015); the same number here.
constexpr int k_flux_samples = 100000;
constexpr double k_flux_tolerance = 0.008;

TEST(BsdfReferenceFlux, RoughPlastic) {
  struct Case {
    MicrofacetKind kind;
    float alpha, cos_theta, flux;
  };
  const Case cases[] = {
      {MicrofacetKind::ggx, 0.05f, 0.8f, 0.9574f},      {MicrofacetKind::ggx, 0.05f, 0.3f, 0.9575f},
      {MicrofacetKind::ggx, 0.2f, 0.8f, 0.7944f},       {MicrofacetKind::ggx, 0.2f, 0.3f, 0.7705f},
      {MicrofacetKind::ggx, 0.6f, 0.8f, 0.4748f},       {MicrofacetKind::ggx, 0.6f, 0.3f, 0.4027f},
      {MicrofacetKind::beckmann, 0.05f, 0.8f, 0.9774f}, {MicrofacetKind::beckmann, 0.05f, 0.3f, 0.9807f},
      {MicrofacetKind::beckmann, 0.2f, 0.8f, 0.9314f},  {MicrofacetKind::beckmann, 0.2f, 0.3f, 0.9059f},
      {MicrofacetKind::beckmann, 0.6f, 0.8f, 0.6761f},  {MicrofacetKind::beckmann, 0.6f, 0.3f, 0.6677f},
  };
  test::Random random(41);
  for (const Case& c : cases) {
    const Material m = test::rough_plastic(c.kind, c.alpha, 1.0f, 1.49f);
    EXPECT_NEAR(test::mean_flux(m, test::direction(c.cos_theta, 0.3f), random, k_flux_samples), c.flux,
                k_flux_tolerance)
        << int(c.kind) << " " << c.alpha << " " << c.cos_theta;
  }
}

TEST(BsdfReferenceFlux, RoughDielectricFromBothSides) {
  struct Case {
    MicrofacetKind kind;
    float alpha_u, alpha_v, ior, cos_theta, flux;
  };
  const Case cases[] = {
      {MicrofacetKind::ggx, 0.4f, 0.4f, 1.5f, 0.9f, 0.9728f},
      {MicrofacetKind::ggx, 0.4f, 0.4f, 1.5f, 0.3f, 0.8663f},
      {MicrofacetKind::ggx, 0.4f, 0.4f, 1.5f, -0.9f, 0.8047f},
      {MicrofacetKind::ggx, 0.4f, 0.4f, 1.5f, -0.4f, 0.6916f},
      {MicrofacetKind::ggx, 0.2f, 0.6f, 1.8f, 0.9f, 0.9546f},
      {MicrofacetKind::ggx, 0.2f, 0.6f, 1.8f, 0.3f, 0.8648f},
      {MicrofacetKind::ggx, 0.2f, 0.6f, 1.8f, -0.9f, 0.7383f},
      {MicrofacetKind::ggx, 0.2f, 0.6f, 1.8f, -0.4f, 0.7045f},
      {MicrofacetKind::beckmann, 0.5f, 0.5f, 1.33f, 0.9f, 0.9955f},
      {MicrofacetKind::beckmann, 0.5f, 0.5f, 1.33f, 0.3f, 0.9562f},
      {MicrofacetKind::beckmann, 0.5f, 0.5f, 1.33f, -0.9f, 0.9249f},
      {MicrofacetKind::beckmann, 0.5f, 0.5f, 1.33f, -0.4f, 0.7176f},
      {MicrofacetKind::beckmann, 0.8f, 0.3f, 2.4f, 0.9f, 0.9656f},
      {MicrofacetKind::beckmann, 0.8f, 0.3f, 2.4f, 0.3f, 0.9558f},
      {MicrofacetKind::beckmann, 0.8f, 0.3f, 2.4f, -0.9f, 0.8380f},
      {MicrofacetKind::beckmann, 0.8f, 0.3f, 2.4f, -0.4f, 0.8434f},
      {MicrofacetKind::ggx, 0.5f, 0.5f, 0.7f, 0.9f, 0.7467f},
      {MicrofacetKind::ggx, 0.5f, 0.5f, 0.7f, 0.3f, 0.5994f},
      {MicrofacetKind::ggx, 0.5f, 0.5f, 0.7f, -0.9f, 0.9624f},
      {MicrofacetKind::ggx, 0.5f, 0.5f, 0.7f, -0.4f, 0.8514f},
  };
  test::Random random(42);
  for (const Case& c : cases) {
    const Material m = test::rough_glass(c.kind, c.alpha_u, c.alpha_v, c.ior);
    EXPECT_NEAR(test::mean_flux(m, test::direction(c.cos_theta, 0.3f), random, k_flux_samples), c.flux,
                k_flux_tolerance)
        << int(c.kind) << " " << c.alpha_u << " " << c.cos_theta;
  }
}

TEST(BsdfReferenceFlux, Principled) {
  struct Case {
    float roughness, metallic, clearcoat, cos_theta, flux;
  };
  const Case cases[] = {
      {0.5f, 0.0f, 0.0f, 0.9f, 0.8416f}, {0.5f, 0.0f, 0.0f, 0.3f, 0.9186f}, {0.6f, 1.0f, 0.0f, 0.9f, 0.6523f},
      {0.6f, 1.0f, 0.0f, 0.3f, 0.6323f}, {0.7f, 0.3f, 1.0f, 0.9f, 0.7795f}, {0.7f, 0.3f, 1.0f, 0.3f, 0.8296f},
  };
  test::Random random(43);
  for (const Case& c : cases) {
    const Material m = test::principled(0.8f, c.roughness, c.metallic, c.clearcoat);
    EXPECT_NEAR(test::mean_flux(m, test::direction(c.cos_theta, 0.3f), random, k_flux_samples), c.flux,
                k_flux_tolerance)
        << c.roughness << " " << c.cos_theta;
  }
}

}  // namespace
}  // namespace fieldtrace
