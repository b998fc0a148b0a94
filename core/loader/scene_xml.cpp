#include "core/loader/scene_xml.h"

#include <algorithm>

#include "core/loader/scene_builder.h"

namespace fieldtrace {
namespace {

// Builds the direct children of <scene>. Materials and textures are built when shapes refer to them: unused ones cost
// nothing and may be of an unsupported kind.
void build_scene(SceneBuilder& builder) {
  const SceneNode *integrator = nullptr, *sensor = nullptr;
  for (const SceneNode& node : builder.tree.root.children) {
    if (node.tag == "shape") {
      build_shape(builder, node);
    } else if (node.tag == "emitter") {
      build_emitter(builder, node);
    } else if (node.tag == "sensor") {
      if (sensor)
        builder.diagnostics.warning(node.where, "the scene has several sensors; the first is used");
      else
        sensor = &node;
    } else if (node.tag == "integrator") {
      if (integrator) throw Error(node.where, "the scene has two integrators; remove one");
      integrator = &node;
    } else if (node.tag != "bsdf" && node.tag != "texture") {
      builder.diagnostics.unknown(node.where, "<" + node.tag + "> has no meaning directly inside <scene>, ignored");
    }
  }
  const SourceLocation& where = builder.tree.root.where;
  if (builder.scene.instances.empty()) builder.diagnostics.warning(where, "the scene has no shapes");
  if (sensor) {
    build_sensor(builder, *sensor);
  } else {
    builder.diagnostics.warning(where, "the scene has no sensor; one that sees everything from -z is used");
    builder.places.camera = where;
    build_default_sensor(builder);
  }
  if (integrator) build_integrator(builder, *integrator);
}

}  // namespace

Scene load_scene(const std::string& path, const SceneLoadOptions& options) {
  const Diagnostics diagnostics{options.strict, options.warning};
  SceneTree tree;
  load_scene_tree(path, options.parameters, diagnostics, tree);
  SceneBuilder builder(tree, diagnostics);
  builder.scene.files = tree.files;
  builder.scene.parameters = options.parameters;
  build_scene(builder);
  recentre_meshes(builder.scene, builder.placement);
  place_scene(builder.scene, builder.placement);
  builder.places.scene = tree.root.where;
  check_scene_limits(builder.scene, builder.places);
  warn_of_blurred_triangles(builder.scene, builder.places, diagnostics);
  return std::move(builder.scene);
}

}  // namespace fieldtrace
