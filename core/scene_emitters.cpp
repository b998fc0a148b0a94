// Light sources of scene files (build_emitter() and build_area_light() of scene_builder.h).

#include "core/scene_builder.h"
#include "core/scene_transforms.h"

namespace fieldtrace {
namespace {

void add_emitter(SceneBuilder& builder, const Emitter& emitter, const DVec3& position) {
  builder.scene.emitters.push_back(emitter);
  builder.placement.emitters.push_back(position);
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
  add_emitter(builder, emitter, DVec3(0.0));
}

void build_emitter(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  Emitter emitter;
  DVec3 position(0.0);
  if (node.type == "area") {
    throw Error(node.where, "an area light must be inside the <shape> that glows; move it there");
  } else if (node.type == "envmap") {
    throw_not_available(node);
  } else if (node.type == "constant") {
    emitter.kind = EmitterKind::constant;
    emitter.value = properties.colour("radiance", Rgb(1.0f), ColourRole::emission);
    for (const Emitter& other : builder.scene.emitters)
      if (other.kind == EmitterKind::constant)
        throw Error(node.where, "the scene has two surrounding emitters; remove one");
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
  add_emitter(builder, emitter, position);
}

}  // namespace fieldtrace
