// Materials of scene files (build_bsdf() of scene_builder.h).

#include <algorithm>
#include <cmath>

#include "core/loader/scene_builder.h"
#include "core/material/named_materials.h"
#include "core/material/rough_transmittance.h"

namespace fieldtrace {
namespace {

uint32_t add_bsdf(SceneBuilder& builder, Bsdf bsdf) {
  builder.scene.bsdfs.push_back(std::move(bsdf));
  return uint32_t(builder.scene.bsdfs.size() - 1);
}

// The transmittance table of a rough plastic's interface, shared by equal interfaces.
uint32_t add_rough_transmittance(SceneBuilder& builder, const Bsdf& bsdf) {
  const Microfacet microfacet{bsdf.microfacet, std::max(bsdf.alpha_u, k_min_alpha),
                              std::max(bsdf.alpha_v, k_min_alpha)};
  const float relative_ior = bsdf.int_ior / bsdf.ext_ior;
  const auto [found, inserted] =
      builder.rough_transmittances.emplace(std::tuple(microfacet.kind, microfacet.alpha_u, relative_ior), k_none);
  if (inserted) {
    builder.scene.rough_transmittances.push_back(make_rough_transmittance(microfacet, relative_ior));
    found->second = uint32_t(builder.scene.rough_transmittances.size() - 1);
  }
  return found->second;
}

Bsdf parse_diffuse(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  Bsdf bsdf;
  bsdf.kind = BsdfKind::diffuse;
  bsdf.reflectance = build_texture(builder, properties, "reflectance", Rgb(0.5f));
  return bsdf;
}

// A refractive index: a number or a name.
float parse_index(Properties& properties, const std::string& name, const std::string& missing) {
  const SceneNode* node = properties.find(name);
  if (node && node->tag != "string") return float(properties.number(name, 1.0, k_positive));
  const std::string medium = properties.string(name, missing);
  const std::optional<float> index = find_refractive_index(medium);
  if (!index)
    throw Error(properties.where(name), "unknown medium '" + medium + "' for '" + name + "'; give a number or one of " +
                                            refractive_index_names());
  return *index;
}

Bsdf parse_conductor(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  Bsdf bsdf;
  bsdf.kind = BsdfKind::conductor;
  bsdf.reflectance = build_texture(builder, properties, "specular_reflectance", Rgb(1.0f));
  const bool given = properties.has("eta") || properties.has("k");
  if (given && properties.has("material"))
    throw Error(properties.where("material"), "both a material and eta, k are given; use one of them");
  const std::string name = properties.string("material", "none");
  const std::optional<ComplexIndex> metal = find_metal(name);
  if (!metal) throw Error(properties.where("material"), "unknown material '" + name + "'; use one of " + metal_names());
  bsdf.eta = properties.colour("eta", metal->eta, ColourRole::index);
  bsdf.k = properties.colour("k", metal->k, ColourRole::index);
  const float outside = parse_index(properties, "ext_eta", "vacuum");
  // Beyond this metals reflect everything, and their squares would overflow.
  constexpr float k_largest_index = 0x1p20f;
  bsdf.eta = glm::min(bsdf.eta / outside, Rgb(k_largest_index));
  bsdf.k = glm::min(bsdf.k / outside, Rgb(k_largest_index));
  return bsdf;
}

void refuse_textures(Properties& properties, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const SceneNode* value = properties.find(name);
    if (value && value->tag == "texture")
      throw Error(value->where, "a texture for '" + std::string(name) + "' is not available yet; give a number");
  }
}

void parse_distribution(Properties& properties, Bsdf& bsdf) {
  bsdf.microfacet = properties.choice("distribution", "beckmann", {"beckmann", "ggx"}) == "ggx"
                        ? MicrofacetKind::ggx
                        : MicrofacetKind::beckmann;
  properties.ignore({"sample_visible"});
}

// The distribution and its roughness, equal along both axes or not.
void parse_microfacet(const SceneNode& node, Properties& properties, Bsdf& bsdf) {
  parse_distribution(properties, bsdf);
  refuse_textures(properties, {"alpha", "alpha_u", "alpha_v"});
  const bool split = properties.has("alpha_u") || properties.has("alpha_v");
  if (split && properties.has("alpha"))
    throw Error(properties.where("alpha"), "both alpha and alpha_u, alpha_v are given; use one of them");
  if (split && !(properties.has("alpha_u") && properties.has("alpha_v")))
    throw Error(node.where, "alpha_u and alpha_v must be given together");
  const double alpha = properties.number("alpha", 0.1, k_positive);
  bsdf.alpha_u = float(properties.number("alpha_u", alpha, k_positive));
  bsdf.alpha_v = float(properties.number("alpha_v", alpha, k_positive));
}

Bsdf parse_rough_conductor(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Bsdf bsdf = parse_conductor(builder, node, properties);
  bsdf.kind = BsdfKind::rough_conductor;
  parse_microfacet(node, properties, bsdf);
  return bsdf;
}

void parse_indices(Properties& properties, const std::string& inside, Bsdf& bsdf) {
  bsdf.int_ior = parse_index(properties, "int_ior", inside);
  bsdf.ext_ior = parse_index(properties, "ext_ior", "air");
  // Beyond this an interface reflects all light from one side but for what single precision cannot tell from 1.
  constexpr float k_largest_index = 1000.0f;
  const float relative = std::max(bsdf.int_ior, bsdf.ext_ior) / std::min(bsdf.int_ior, bsdf.ext_ior);
  if (!(relative <= k_largest_index)) {
    const char* const name = properties.has("int_ior") ? "int_ior" : "ext_ior";
    throw Error(properties.where(name), "int_ior and ext_ior differ by more than 1000 times; check the numbers");
  }
}

// Rough interfaces between equal indices have no half vectors.
void demand_different_indices(const SceneNode& node, const Bsdf& bsdf) {
  if (bsdf.int_ior == bsdf.ext_ior)
    throw Error(node.where, "int_ior and ext_ior must differ for <bsdf type=\"" + node.type + "\">");
}

Bsdf parse_dielectric(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  Bsdf bsdf;
  bsdf.kind = BsdfKind::dielectric;
  parse_indices(properties, "bk7", bsdf);
  bsdf.reflectance = build_texture(builder, properties, "specular_reflectance", Rgb(1.0f));
  bsdf.transmittance = build_texture(builder, properties, "specular_transmittance", Rgb(1.0f));
  return bsdf;
}

Bsdf parse_thin_dielectric(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Bsdf bsdf = parse_dielectric(builder, node, properties);
  bsdf.kind = BsdfKind::thin_dielectric;
  return bsdf;
}

Bsdf parse_rough_dielectric(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Bsdf bsdf = parse_dielectric(builder, node, properties);
  bsdf.kind = BsdfKind::rough_dielectric;
  demand_different_indices(node, bsdf);
  parse_microfacet(node, properties, bsdf);
  return bsdf;
}

Bsdf parse_plastic(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  Bsdf bsdf;
  bsdf.kind = BsdfKind::plastic;
  parse_indices(properties, "polypropylene", bsdf);
  bsdf.diffuse_reflectance = build_texture(builder, properties, "diffuse_reflectance", Rgb(0.5f));
  bsdf.reflectance = build_texture(builder, properties, "specular_reflectance", Rgb(1.0f));
  bsdf.nonlinear = properties.boolean("nonlinear", false);
  return bsdf;
}

Bsdf parse_rough_plastic(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Bsdf bsdf = parse_plastic(builder, node, properties);
  bsdf.kind = BsdfKind::rough_plastic;
  demand_different_indices(node, bsdf);
  parse_distribution(properties, bsdf);
  for (const char* name : {"alpha_u", "alpha_v"})
    if (properties.has(name))
      throw Error(properties.where(name), "<bsdf type=\"roughplastic\"> has one roughness for all directions, alpha");
  refuse_textures(properties, {"alpha"});
  bsdf.alpha_u = bsdf.alpha_v = float(properties.number("alpha", 0.1, k_positive));
  bsdf.rough_transmittance = add_rough_transmittance(builder, bsdf);
  return bsdf;
}

// Relative index of refraction whose reflectance at normal incidence is 0.08 x specular (Burley 2012, section 5.3).
float index_of_specular(double specular) { return float(2.0 / (1.0 - std::sqrt(0.08 * specular)) - 1.0); }

// Supports the lobes of bsdf_principled.cpp; others are reported where the file uses them.
Bsdf parse_principled(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  constexpr Range k_share = {0.0, 1.0};
  Bsdf bsdf;
  bsdf.kind = BsdfKind::principled;
  bsdf.microfacet = MicrofacetKind::ggx;
  bsdf.reflectance = build_texture(builder, properties, "base_color", Rgb(0.5f));
  refuse_textures(properties, {"roughness", "anisotropic", "metallic", "clearcoat", "clearcoat_gloss"});
  bsdf.roughness = float(properties.number("roughness", 0.5, k_share));
  bsdf.metallic = float(properties.number("metallic", 0.0, k_share));
  bsdf.clearcoat = float(properties.number("clearcoat", 0.0, k_share));
  // Linear from rough to glossy (Burley 2012, section 5.3).
  const double gloss = properties.number("clearcoat_gloss", 0.0, k_share);
  bsdf.clearcoat_alpha = float(0.1 + (0.001 - 0.1) * gloss);
  if (properties.has("eta") && properties.has("specular"))
    throw Error(properties.where("eta"), "both eta and specular are given; use one of them");
  bsdf.ext_ior = 1.0f;
  bsdf.int_ior =
      float(properties.number("eta", index_of_specular(properties.number("specular", 0.5, k_share)), k_positive));
  const float aspect = std::sqrt(1.0f - 0.9f * float(properties.number("anisotropic", 0.0, k_share)));
  constexpr float k_least_alpha = 0.001f;  // Mitsuba's
  bsdf.alpha_u = std::max(bsdf.roughness * bsdf.roughness / aspect, k_least_alpha);
  bsdf.alpha_v = std::max(bsdf.roughness * bsdf.roughness * aspect, k_least_alpha);
  for (const char* name : {"spec_trans", "sheen", "flatness", "spec_tint"}) {
    const SceneNode* value = properties.find(name);
    if (value && (value->tag == "texture" || properties.number(name, 0.0) != 0.0))
      builder.diagnostics.unknown(value->where,
                                  "'" + std::string(name) + "' of <bsdf type=\"principled\"> is left out");
  }
  properties.ignore(
      {"sheen_tint", "diffuse_reflectance_sampling_rate", "main_specular_sampling_rate", "clearcoat_sampling_rate"});
  return bsdf;
}

// The nested material with an opacity mask.
Bsdf parse_mask(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  const uint32_t opacity = build_texture(builder, properties, "opacity", Rgb(0.5f));
  const std::vector<const SceneNode*> nested = properties.objects("bsdf");
  if (nested.size() != 1)
    throw Error(node.where, "<bsdf type=\"mask\"> needs one <bsdf> inside, not " + std::to_string(nested.size()));
  Bsdf bsdf = builder.scene.bsdfs[build_bsdf(builder, *nested[0])];
  if (bsdf.opacity != k_none)
    throw Error(nested[0]->where, "a mask cannot be inside 'mask'; multiply the opacities and use one of them");
  bsdf.opacity = opacity;
  return bsdf;
}

// One or two nested materials: one for both sides, or one each for front and back.
Bsdf parse_two_sided(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  const std::vector<const SceneNode*> nested = properties.objects("bsdf");
  if (nested.empty() || nested.size() > 2)
    throw Error(node.where,
                "<bsdf type=\"twosided\"> needs one or two <bsdf> inside, not " + std::to_string(nested.size()));
  uint32_t sides[2] = {k_none, k_none};
  for (size_t i = 0; i < nested.size(); ++i) {
    sides[i] = build_bsdf(builder, *nested[i]);
    const Bsdf& side = builder.scene.bsdfs[sides[i]];
    if (transmits(side.kind))
      throw Error(nested[i]->where,
                  "a dielectric cannot be inside 'twosided': it has two sides of its own; take it out");
    if (side.opacity != k_none)
      throw Error(nested[i]->where, "a mask cannot be inside 'twosided'; put the 'twosided' inside the mask");
  }
  Bsdf bsdf = builder.scene.bsdfs[sides[0]];
  bsdf.two_sided = true;
  bsdf.back = sides[1];
  return bsdf;
}

struct BsdfParser {
  const char* type;
  Bsdf (*parse)(SceneBuilder&, const SceneNode&, Properties&);
};
constexpr BsdfParser k_parsers[] = {
    {"diffuse", parse_diffuse},
    {"conductor", parse_conductor},
    {"roughconductor", parse_rough_conductor},
    {"dielectric", parse_dielectric},
    {"twosided", parse_two_sided},
    {"roughdielectric", parse_rough_dielectric},
    {"thindielectric", parse_thin_dielectric},
    {"plastic", parse_plastic},
    {"roughplastic", parse_rough_plastic},
    {"principled", parse_principled},
    {"mask", parse_mask},
};

// The diffuse BSDF of the given albedo, created on first use.
uint32_t shared_diffuse(SceneBuilder& builder, uint32_t& index, float albedo) {
  if (index == k_none) {
    Bsdf bsdf;
    bsdf.reflectance = add_constant_texture(builder, Rgb(albedo));
    index = add_bsdf(builder, bsdf);
  }
  return index;
}

}  // namespace

uint32_t build_default_bsdf(SceneBuilder& builder) { return shared_diffuse(builder, builder.default_bsdf, 0.5f); }
uint32_t build_emitter_bsdf(SceneBuilder& builder) { return shared_diffuse(builder, builder.emitter_bsdf, 0.0f); }

uint32_t build_bsdf(SceneBuilder& builder, const SceneNode& node) {
  const auto known = builder.bsdfs.find(&node);
  if (known != builder.bsdfs.end()) return known->second;
  for (const BsdfParser& parser : k_parsers) {
    if (node.type != parser.type) continue;
    if (!builder.open.insert(&node).second)
      throw Error(node.where, "the <bsdf> contains itself by a <ref>; remove the cycle");
    Properties properties = builder.properties(node);
    Bsdf bsdf = parser.parse(builder, node, properties);
    bsdf.id = node.id;
    properties.finish();
    builder.open.erase(&node);
    return builder.bsdfs[&node] = add_bsdf(builder, std::move(bsdf));
  }
  builder.diagnostics.unknown(node.where, "unknown bsdf type '" + node.type + "', replaced by diffuse grey 0.5");
  return builder.bsdfs[&node] = build_default_bsdf(builder);
}

}  // namespace fieldtrace
