// Light sources of scene files (build_emitter() and build_area_light() of scene_builder.h).

#include <algorithm>
#include <limits>

#include "core/light/light_environment.h"
#include "core/loader/scene_builder.h"
#include "core/loader/scene_transforms.h"

namespace fieldtrace {
namespace {

void add_emitter(SceneBuilder& builder, const Emitter& emitter, const DVec3& position, const SourceLocation& where) {
  builder.scene.emitters.push_back(emitter);
  builder.placement.emitters.push_back(position);
  builder.places.emitters.push_back(where);
}

DVec3 parse_position(Properties& properties) {
  if (properties.has("position") && properties.has("to_world"))
    throw Error(properties.where("to_world"), "both position and to_world are given; use one of them");
  if (properties.has("position")) return properties.point("position", DVec3(0.0));
  return properties.transform("to_world")[3];
}

Vec3 parse_direction(Properties& properties) {
  if (properties.has("direction") && properties.has("to_world"))
    throw Error(properties.where("to_world"), "both direction and to_world are given; use one of them");
  const DVec3 direction = properties.has("direction") ? properties.point("direction", DVec3(0.0, 0.0, 1.0))
                                                      : properties.transform("to_world")[2];
  const double length = glm::length(direction);
  if (!(length > 0))
    throw Error(properties.where(properties.has("direction") ? "direction" : "to_world"),
                "the direction of the light has no length; give one such as 0 0 -1");
  return Vec3(direction / length);
}

// The orthonormal columns nearest to those of a rigid transform, whose entries may be rounded.
Mat3 orthonormal(const DAffine& t) {
  const DVec3 x = glm::normalize(t[0]);
  const DVec3 y = glm::normalize(t[1] - x * glm::dot(x, t[1]));
  const DVec3 z = glm::normalize(t[2] - x * glm::dot(x, t[2]) - y * glm::dot(y, t[2]));
  return Mat3(Vec3(x), Vec3(y), Vec3(z));
}

// Reports maps and pixels that an environment cannot use.
void check_environment(const SceneBuilder& builder, const Bitmap& map, const std::string& path, double scale,
                       const SourceLocation& where) {
  if (map.width < k_least_environment_width || map.height < k_least_environment_height ||
      size_t(map.width) * size_t(map.height) > k_most_environment_texels) {
    throw Error(where, "the environment map '" + path + "' has " + std::to_string(map.width) + " x " +
                           std::to_string(map.height) + " pixels; it needs at least " +
                           std::to_string(k_least_environment_width) + " x " +
                           std::to_string(k_least_environment_height) + ", and at most " +
                           std::to_string(k_most_environment_texels) + " pixels in all");
  }
  float largest = 0.0f;
  size_t negative = 0;
  for (const Rgb& p : map.pixels) {
    largest = std::max({largest, p.x, p.y, p.z});
    negative += p.x < 0.0f || p.y < 0.0f || p.z < 0.0f;
  }
  // Half of the range is reserved for the power of two that the light table divides by.
  if (scale * double(largest) > 0.5 * double(std::numeric_limits<float>::max()))
    throw Error(where,
                "the environment map '" + path + "' times its scale is beyond single precision; lower the scale");
  if (negative > 0) {
    builder.diagnostics.warning(where, "the environment map '" + path + "' has " + std::to_string(negative) +
                                           " pixels with negative values, which count as 0");
  }
  if (largest == 0.0f) builder.diagnostics.warning(where, "the environment map '" + path + "' is black");
}

void parse_environment(SceneBuilder& builder, const SceneNode& node, Properties& properties, Emitter& emitter) {
  emitter.kind = EmitterKind::environment;
  const std::string filename = properties.string("filename", "");
  if (filename.empty()) throw Error(node.where, "<emitter type=\"envmap\"> lacks its filename");
  const double scale = properties.number("scale", 1.0, k_not_negative);
  emitter.value = Rgb(float(scale));
  emitter.rotation = orthonormal(rigid_part(properties.transform("to_world"), "the environment map",
                                            properties.where("to_world"), builder.diagnostics));
  const SourceLocation where = properties.where("filename");
  const std::string path = builder.input_file(node, filename);
  emitter.bitmap = build_bitmap(builder, path, BitmapUse::radiance, where);
  check_environment(builder, builder.scene.bitmaps[emitter.bitmap], path, scale, where);
  // Sampling is the renderer's decision.
  properties.ignore({"mis_compensation"});
}

// As in Mitsuba, a scene has at most one light surrounding it.
void require_only_surrounding(const SceneBuilder& builder, const SceneNode& node) {
  for (const Emitter& other : builder.scene.emitters)
    if (other.kind == EmitterKind::constant || other.kind == EmitterKind::environment)
      throw Error(node.where, "the scene has two surrounding emitters; remove one");
}

}  // namespace

void build_area_light(SceneBuilder& builder, const SceneNode& node, uint32_t instance) {
  if (node.type != "area") {
    builder.diagnostics.unknown(node.where, "unknown emitter type '" + node.type + "' on a shape, left out");
    return;
  }
  Properties properties = builder.properties(node);
  Emitter emitter;
  emitter.kind = EmitterKind::area;
  emitter.value = properties.colour("radiance", Rgb(1.0f), ColourRole::emission);
  emitter.instance = instance;
  properties.ignore({"sampling_weight"});
  properties.finish();
  builder.scene.instances[instance].emitter = uint32_t(builder.scene.emitters.size());
  add_emitter(builder, emitter, DVec3(0.0), node.where);
}

void build_emitter(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  Emitter emitter;
  DVec3 position(0.0);
  if (node.type == "area") {
    throw Error(node.where, "an area light must be inside the <shape> that glows; move it there");
  } else if (node.type == "envmap") {
    require_only_surrounding(builder, node);
    parse_environment(builder, node, properties, emitter);
  } else if (node.type == "constant") {
    emitter.kind = EmitterKind::constant;
    emitter.value = properties.colour("radiance", Rgb(1.0f), ColourRole::emission);
    require_only_surrounding(builder, node);
  } else if (node.type == "point") {
    emitter.kind = EmitterKind::point;
    emitter.value = properties.colour("intensity", Rgb(1.0f), ColourRole::emission);
    position = parse_position(properties);
  } else if (node.type == "directional") {
    emitter.kind = EmitterKind::directional;
    emitter.value = properties.colour("irradiance", Rgb(1.0f), ColourRole::emission);
    emitter.direction = parse_direction(properties);
  } else {
    builder.diagnostics.unknown(node.where, "unknown emitter type '" + node.type + "', left out");
    return;
  }
  properties.ignore({"sampling_weight"});
  properties.finish();
  add_emitter(builder, emitter, position, properties.where(properties.has("position") ? "position" : "to_world"));
}

}  // namespace fieldtrace
