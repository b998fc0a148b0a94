// How the scene loader reads dielectrics, plastics, principled materials and masks: defaults, names, nesting.

#include "core/material/bsdf.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

class SceneBsdfs : public SceneFiles {
 protected:
  // The material of a sphere with the nested elements `xml`.
  Bsdf bsdf(const std::string& xml) {
    scene = load(k_sensor + "<shape type=\"sphere\">" + xml + "</shape>");
    return scene.bsdfs[scene.instances[0].bsdf];
  }
  Rgb colour(uint32_t texture) const { return scene.textures[texture].color0; }

  Scene scene;
};

// Mitsuba's indices of named media.
constexpr float k_bk7 = 1.5046f, k_polypropylene = 1.49f, k_air = 1.000277f;

TEST_F(SceneBsdfs, RoughDielectric) {
  Bsdf b = bsdf("<bsdf type=\"roughdielectric\"/>");
  EXPECT_EQ(b.kind, BsdfKind::rough_dielectric);
  EXPECT_EQ(b.microfacet, MicrofacetKind::beckmann);
  EXPECT_EQ(b.alpha_u, 0.1f);
  EXPECT_EQ(b.alpha_v, 0.1f);
  EXPECT_FLOAT_EQ(b.int_ior, k_bk7);
  EXPECT_FLOAT_EQ(b.ext_ior, k_air);
  EXPECT_EQ(colour(b.transmittance), Rgb(1.0f));
  b = bsdf(
      "<bsdf type=\"roughdielectric\"><string name=\"distribution\" value=\"ggx\"/><float name=\"alpha_u\" "
      "value=\".2\"/><float name=\"alpha_v\" value=\".3\"/><float name=\"int_ior\" value=\"1.3\"/><rgb "
      "name=\"specular_transmittance\" value=\".5\"/><boolean name=\"sample_visible\" value=\"true\"/></bsdf>");
  EXPECT_EQ(b.microfacet, MicrofacetKind::ggx);
  EXPECT_EQ(b.alpha_u, 0.2f);
  EXPECT_EQ(b.alpha_v, 0.3f);
  EXPECT_EQ(b.int_ior, 1.3f);
  EXPECT_EQ(colour(b.transmittance), Rgb(0.5f));
  EXPECT_TRUE(warnings.empty());
}

TEST_F(SceneBsdfs, ThinDielectric) {
  const Bsdf b = bsdf(
      "<bsdf type=\"thindielectric\"><string name=\"int_ior\" value=\"water\"/><rgb name=\"specular_reflectance\" "
      "value=\".25\"/></bsdf>");
  EXPECT_EQ(b.kind, BsdfKind::thin_dielectric);
  EXPECT_FLOAT_EQ(b.int_ior, 1.333f);
  EXPECT_EQ(colour(b.reflectance), Rgb(0.25f));
  EXPECT_EQ(colour(b.transmittance), Rgb(1.0f));
}

TEST_F(SceneBsdfs, Plastic) {
  Bsdf b = bsdf("<bsdf type=\"plastic\"/>");
  EXPECT_EQ(b.kind, BsdfKind::plastic);
  EXPECT_FLOAT_EQ(b.int_ior, k_polypropylene);
  EXPECT_FLOAT_EQ(b.ext_ior, k_air);
  EXPECT_EQ(colour(b.diffuse_reflectance), Rgb(0.5f));
  EXPECT_EQ(colour(b.reflectance), Rgb(1.0f));
  EXPECT_FALSE(b.nonlinear);
  b = bsdf(
      "<bsdf type=\"plastic\"><boolean name=\"nonlinear\" value=\"true\"/><texture type=\"checkerboard\" "
      "name=\"diffuse_reflectance\"/></bsdf>");
  EXPECT_TRUE(b.nonlinear);
  EXPECT_EQ(scene.textures[b.diffuse_reflectance].kind, TextureKind::checkerboard);
  const Material m = resolve_material(scene, scene.instances[0].bsdf, Vec2(0.1f), 1.0f);
  EXPECT_EQ(m.diffuse_reflectance, Rgb(0.4f));
  EXPECT_TRUE(m.nonlinear);
  EXPECT_EQ(material_albedo(m), Rgb(0.4f));
}

TEST_F(SceneBsdfs, RoughPlasticsOfOneInterfaceShareTheirTable) {
  const std::string first = "<bsdf type=\"roughplastic\"/>",
                    second = "<bsdf type=\"roughplastic\"><rgb name=\"diffuse_reflectance\" value=\".1\"/></bsdf>",
                    third = "<bsdf type=\"roughplastic\"><float name=\"alpha\" value=\".2\"/></bsdf>";
  std::string body = k_sensor;
  for (const std::string& b : {first, second, third}) body += "<shape type=\"sphere\">" + b + "</shape>";
  const Scene s = load(body);
  EXPECT_EQ(s.bsdfs[0].kind, BsdfKind::rough_plastic);
  EXPECT_EQ(s.bsdfs[0].alpha_u, 0.1f);
  ASSERT_EQ(s.rough_transmittances.size(), 2u);
  EXPECT_EQ(s.bsdfs[0].rough_transmittance, s.bsdfs[1].rough_transmittance);
  EXPECT_NE(s.bsdfs[0].rough_transmittance, s.bsdfs[2].rough_transmittance);
  const Material m = resolve_material(s, 2, {}, 1.0f);
  EXPECT_EQ(m.rough_transmittance, &s.rough_transmittances[s.bsdfs[2].rough_transmittance]);
  EXPECT_EQ(m.microfacet.alpha_v, 0.2f);
}

TEST_F(SceneBsdfs, Principled) {
  Bsdf b = bsdf("<bsdf type=\"principled\"/>");
  EXPECT_EQ(b.kind, BsdfKind::principled);
  EXPECT_EQ(b.microfacet, MicrofacetKind::ggx);
  EXPECT_EQ(colour(b.reflectance), Rgb(0.5f));
  EXPECT_EQ(b.roughness, 0.5f);
  EXPECT_EQ(b.alpha_u, 0.25f);
  EXPECT_EQ(b.metallic, 0.0f);
  EXPECT_EQ(b.clearcoat, 0.0f);
  EXPECT_FLOAT_EQ(b.int_ior / b.ext_ior, 1.5f);  // specular 0.5: reflectance 0.04
  b = bsdf(
      "<bsdf type=\"principled\"><float name=\"roughness\" value=\"0\"/><float name=\"metallic\" value=\"1\"/><float "
      "name=\"eta\" value=\"1.7\"/><float name=\"clearcoat\" value=\".5\"/><float name=\"clearcoat_gloss\" "
      "value=\"1\"/><float name=\"sheen\" value=\"0\"/><float name=\"sheen_tint\" value=\".3\"/></bsdf>");
  EXPECT_EQ(b.alpha_u, 0.001f);
  EXPECT_EQ(b.metallic, 1.0f);
  EXPECT_FLOAT_EQ(b.int_ior, 1.7f);
  EXPECT_EQ(b.clearcoat, 0.5f);
  EXPECT_FLOAT_EQ(b.clearcoat_alpha, 0.001f);
  EXPECT_TRUE(warnings.empty());
  b = bsdf("<bsdf type=\"principled\"><float name=\"anisotropic\" value=\"1\"/></bsdf>");
  EXPECT_NEAR(b.alpha_u / b.alpha_v, 10.0f, 1e-4f);
}

TEST_F(SceneBsdfs, MaskTakesTheNestedMaterial) {
  Bsdf b = bsdf("<bsdf type=\"mask\"><bsdf type=\"conductor\"/></bsdf>");
  EXPECT_EQ(b.kind, BsdfKind::conductor);
  EXPECT_EQ(colour(b.opacity), Rgb(0.5f));
  b = bsdf(
      "<bsdf type=\"mask\"><texture type=\"checkerboard\" name=\"opacity\"/><bsdf type=\"twosided\"><bsdf "
      "type=\"diffuse\"/><bsdf type=\"plastic\"/></bsdf></bsdf>");
  EXPECT_TRUE(b.two_sided);
  const uint32_t index = scene.instances[0].bsdf;
  const Material front = resolve_material(scene, index, Vec2(0.1f), 1.0f);
  const Material back = resolve_material(scene, index, Vec2(0.1f, 0.7f), -1.0f);
  EXPECT_EQ(front.kind, BsdfKind::diffuse);
  EXPECT_EQ(front.opacity, 0.2f);  // as in Mitsuba 3.9, where it is 0.2 as opacity and 0.4 as a colour
  EXPECT_EQ(back.kind, BsdfKind::plastic);
  EXPECT_EQ(back.opacity, 0.4f);
  EXPECT_TRUE(back.turned && !back.dark);
  // A material used both masked and plain stays plain in the latter place.
  const Scene s = load(k_sensor +
                       "<bsdf type=\"diffuse\" id=\"m\"/><shape type=\"sphere\"><bsdf type=\"mask\"><ref "
                       "id=\"m\"/></bsdf></shape><shape type=\"sphere\"><ref id=\"m\"/></shape>");
  EXPECT_NE(s.bsdfs[s.instances[0].bsdf].opacity, k_none);
  EXPECT_EQ(s.bsdfs[s.instances[1].bsdf].opacity, k_none);
}

TEST_F(SceneBsdfs, OpaqueKindsMayBeTwoSided) {
  for (const char* type : {"plastic", "roughplastic", "principled"}) {
    const Bsdf b = bsdf("<bsdf type=\"twosided\"><bsdf type=\"" + std::string(type) + "\"/></bsdf>");
    EXPECT_TRUE(b.two_sided) << type;
    EXPECT_FALSE(resolve_material(scene, scene.instances[0].bsdf, {}, -1.0f).dark) << type;
  }
}

}  // namespace
}  // namespace fieldtrace
