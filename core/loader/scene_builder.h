// The parts of the scene loader that turn elements of a SceneTree into a Scene; driven by scene_xml.cpp.
//
// Source: Mitsuba 3 documentation, plugin reference (names, defaults). All functions throw Error with file and line.
// Thread-safety: one SceneBuilder per load, used by one thread.
#pragma once

#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/io/input_file.h"
#include "core/loader/scene_limits.h"
#include "core/loader/scene_recentre.h"
#include "core/loader/scene_tree.h"
#include "core/loader/scene_values.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// A shape without its place in the scene: a plain shape or one member of a shapegroup.
struct ShapePart {
  std::string id;
  uint32_t shape = k_none, bsdf = k_none;
  bool flip_normals = false;
  DAffine to_world = DAffine(1.0);
  const SceneNode* emitter = nullptr;
  SourceLocation where;  // of to_world, or of the shape
};

// What a bitmap's pixels represent. Reflectances are clamped to [0, 1]; raw: 8-bit values are not decoded from sRGB.
enum class BitmapUse : uint8_t { reflectance, raw_reflectance, radiance };

struct SceneBuilder {
  const SceneTree& tree;
  const Diagnostics& diagnostics;

  SceneBuilder(const SceneTree& tree_, const Diagnostics& diagnostics_) : tree(tree_), diagnostics(diagnostics_) {}

  Scene scene;
  ScenePlacement placement;
  ScenePlaces places;

  // Objects already built, by the element or the parameters that they were built from.
  std::map<const SceneNode*, uint32_t> bsdfs, textures;
  std::map<const SceneNode*, std::vector<ShapePart>> groups;
  std::map<std::string, uint32_t> shapes;
  std::map<std::pair<std::string, BitmapUse>, uint32_t> bitmaps;
  std::map<std::tuple<MicrofacetKind, float, float>, uint32_t> rough_transmittances;  // by roughness and index
  std::map<std::string, bool> own_normals;                                            // whether a mesh file has normals
  uint32_t default_bsdf = k_none, emitter_bsdf = k_none;
  std::set<const SceneNode*> open;  // BSDFs under construction: a reference to one of them is a cycle

  Properties properties(const SceneNode& node) const { return Properties(node, tree, diagnostics); }

  // The existing file that `name` refers to in the file of `node`, recorded in Scene::files. Throws Error if there is
  // none, or if it is a device, a pipe or the like.
  std::string input_file(const SceneNode& node, const std::string& name) {
    std::string path = resolve_file(node, name);
    if (is_special_file(path)) throw Error(node.where, "'" + path + "' " + k_special_file_message);
    scene.files.push_back(path);
    return path;
  }
};

uint32_t add_constant_texture(SceneBuilder& builder, const Rgb& value);
// The texture property `name` (a colour or a <texture>) as an index into Scene::textures; the constant `missing` if it
// is absent.
uint32_t build_texture(SceneBuilder& builder, Properties& properties, const std::string& name, const Rgb& missing);

// The image at `path` as an index into Scene::bitmaps, read once per path and use. Throws Error naming `where` if it
// cannot be read or a pixel is not finite. Reflectances outside [0, 1] give a warning, in strict mode an Error.
uint32_t build_bitmap(SceneBuilder& builder, const std::string& path, BitmapUse use, const SourceLocation& where);

// Index into Scene::bsdfs. An unknown type is reported and becomes the default, a diffuse surface of albedo 0.5.
uint32_t build_bsdf(SceneBuilder& builder, const SceneNode& node);
uint32_t build_default_bsdf(SceneBuilder& builder);
// The black BSDF that an emitter shape without a BSDF gets, as in Mitsuba.
uint32_t build_emitter_bsdf(SceneBuilder& builder);

// Adds the instance (or those of the shapegroup's members) and area lights of a <shape>. A shapegroup by itself adds
// nothing.
void build_shape(SceneBuilder& builder, const SceneNode& node);

// Geometry of a <shape> as an index into Scene::shapes, shared by equal shapes. `part` already holds to_world and
// receives the index and the flip; kinds with geometric parameters (sphere, cylinder) fold them into to_world. Returns
// false for an unknown type, which is reported.
bool build_geometry(SceneBuilder& builder, const SceneNode& node, Properties& properties, ShapePart& part);

// Adds an emitter that is not attached to a shape.
void build_emitter(SceneBuilder& builder, const SceneNode& node);
void build_area_light(SceneBuilder& builder, const SceneNode& node, uint32_t instance);

void build_sensor(SceneBuilder& builder, const SceneNode& node);
// A camera that sees the whole scene, like Mitsuba's, for scenes without a sensor.
void build_default_sensor(SceneBuilder& builder);
void build_integrator(SceneBuilder& builder, const SceneNode& node);

}  // namespace fieldtrace
