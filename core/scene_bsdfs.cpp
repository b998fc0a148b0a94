// Materials of scene files (build_bsdf() of scene_builder.h).

#include "core/named_materials.h"
#include "core/scene_builder.h"

namespace fieldtrace {
namespace {

uint32_t add_bsdf(SceneBuilder& builder, Bsdf bsdf) {
  builder.scene.bsdfs.push_back(std::move(bsdf));
  return uint32_t(builder.scene.bsdfs.size() - 1);
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
  bsdf.eta /= outside;
  bsdf.k /= outside;
  return bsdf;
}

Bsdf parse_rough_conductor(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Bsdf bsdf = parse_conductor(builder, node, properties);
  bsdf.kind = BsdfKind::rough_conductor;
  bsdf.microfacet = properties.choice("distribution", "beckmann", {"beckmann", "ggx"}) == "ggx"
                        ? MicrofacetKind::ggx
                        : MicrofacetKind::beckmann;
  for (const char* name : {"alpha", "alpha_u", "alpha_v"}) {
    const SceneNode* value = properties.find(name);
    if (value && value->tag == "texture")
      throw Error(value->where, "a texture for '" + std::string(name) + "' is not available yet; give a number");
  }
  const bool split = properties.has("alpha_u") || properties.has("alpha_v");
  if (split && properties.has("alpha"))
    throw Error(properties.where("alpha"), "both alpha and alpha_u, alpha_v are given; use one of them");
  if (split && !(properties.has("alpha_u") && properties.has("alpha_v")))
    throw Error(node.where, "alpha_u and alpha_v must be given together");
  const double alpha = properties.number("alpha", 0.1, k_positive);
  bsdf.alpha_u = float(properties.number("alpha_u", alpha, k_positive));
  bsdf.alpha_v = float(properties.number("alpha_v", alpha, k_positive));
  properties.ignore({"sample_visible"});
  return bsdf;
}

Bsdf parse_dielectric(SceneBuilder& builder, const SceneNode&, Properties& properties) {
  Bsdf bsdf;
  bsdf.kind = BsdfKind::dielectric;
  bsdf.int_ior = parse_index(properties, "int_ior", "bk7");
  bsdf.ext_ior = parse_index(properties, "ext_ior", "air");
  bsdf.reflectance = build_texture(builder, properties, "specular_reflectance", Rgb(1.0f));
  bsdf.transmittance = build_texture(builder, properties, "specular_transmittance", Rgb(1.0f));
  return bsdf;
}

// One or two nested materials: for both sides, or for the front and the back.
Bsdf parse_two_sided(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  const std::vector<const SceneNode*> nested = properties.objects("bsdf");
  if (nested.empty() || nested.size() > 2)
    throw Error(node.where,
                "<bsdf type=\"twosided\"> needs one or two <bsdf> inside, not " + std::to_string(nested.size()));
  uint32_t sides[2];
  for (size_t i = 0; i < nested.size(); ++i) {
    sides[i] = build_bsdf(builder, *nested[i]);
    if (builder.scene.bsdfs[sides[i]].kind == BsdfKind::dielectric)
      throw Error(nested[i]->where,
                  "a dielectric cannot be inside 'twosided': it has two sides of its own; take it out");
  }
  Bsdf bsdf = builder.scene.bsdfs[sides[0]];
  bsdf.two_sided = true;
  bsdf.back = nested.size() == 2 ? sides[1] : k_none;
  return bsdf;
}

struct BsdfParser {
  const char* type;
  Bsdf (*parse)(SceneBuilder&, const SceneNode&, Properties&);  // null: not available yet
};
constexpr BsdfParser k_parsers[] = {
    {"diffuse", parse_diffuse},
    {"conductor", parse_conductor},
    {"roughconductor", parse_rough_conductor},
    {"dielectric", parse_dielectric},
    {"twosided", parse_two_sided},
    {"plastic", nullptr},
    {"roughplastic", nullptr},
    {"roughdielectric", nullptr},
    {"thindielectric", nullptr},
    {"mask", nullptr},
    {"principled", nullptr},
};

}  // namespace

void throw_not_available(const SceneNode& node) {
  throw Error(node.where,
              "<" + node.tag + " type=\"" + node.type + "\"> is not available yet; docs/scenes.md lists what is");
}

namespace {

// The diffuse surface of the given albedo, made when it is first needed.
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
    if (!parser.parse) throw_not_available(node);
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
