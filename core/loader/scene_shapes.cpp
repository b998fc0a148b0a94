// Shapes, shape groups and instances of scene files (build_shape() of scene_builder.h).

#include <limits>

#include "core/loader/scene_builder.h"
#include "core/loader/scene_transforms.h"

namespace fieldtrace {
namespace {

// World-space area of the instance's surface. Only whether it is 0 matters, so analytic kinds are measured by their
// tangent boxes.
double surface_area(const Shape& shape, const DAffine& t) {
  const auto parallelogram = [&](const DVec3& a, const DVec3& b) {
    return glm::length(glm::cross(t[0] * a.x + t[1] * a.y + t[2] * a.z, t[0] * b.x + t[1] * b.y + t[2] * b.z));
  };
  const DVec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  if (shape.kind == ShapeKind::disk) return parallelogram(x, y);
  if (shape.kind == ShapeKind::cylinder) return parallelogram(x, z) + parallelogram(y, z);
  if (shape.kind == ShapeKind::sphere) return parallelogram(x, y) + parallelogram(y, z) + parallelogram(z, x);
  double area = 0;
  for (const UVec3& triangle : shape.mesh.triangles) {
    const DVec3 p(shape.mesh.positions[triangle.x]);
    area +=
        0.5 * parallelogram(DVec3(shape.mesh.positions[triangle.y]) - p, DVec3(shape.mesh.positions[triangle.z]) - p);
  }
  return area;
}

// Reads a shape that is neither a shapegroup nor an instance. Returns false for an unknown type.
bool parse_part(SceneBuilder& builder, const SceneNode& node, ShapePart& part) {
  Properties properties = builder.properties(node);
  part.id = node.id;
  part.to_world = properties.transform("to_world");
  part.flip_normals = properties.boolean("flip_normals", false);
  if (!build_geometry(builder, node, properties, part)) return false;
  part.where = properties.where("to_world");
  require_invertible(part.to_world, part.where);
  properties.ignore({"silhouette_sampling_weight"});
  const SceneNode* bsdf = properties.object("bsdf");
  part.emitter = properties.object("emitter");
  part.bsdf = bsdf           ? build_bsdf(builder, *bsdf)
              : part.emitter ? build_emitter_bsdf(builder)
                             : build_default_bsdf(builder);
  properties.finish();
  return true;
}

uint32_t add_instance(SceneBuilder& builder, const ShapePart& part, const std::string& id, const DAffine& to_world,
                      const SourceLocation& where) {
  Instance instance;
  instance.id = id;
  instance.shape = part.shape;
  instance.bsdf = part.bsdf;
  instance.flip_normals = part.flip_normals;
  builder.scene.instances.push_back(instance);
  builder.placement.instances.push_back(to_world);
  builder.places.instances.push_back(where);
  return uint32_t(builder.scene.instances.size() - 1);
}

const std::vector<ShapePart>& build_group(SceneBuilder& builder, const SceneNode& node) {
  const auto known = builder.groups.find(&node);
  if (known != builder.groups.end()) return known->second;
  Properties properties = builder.properties(node);
  std::vector<ShapePart> parts;
  for (const SceneNode* child : properties.objects("shape")) {
    if (child->type == "shapegroup" || child->type == "instance")
      throw Error(child->where, "a <shape type=\"" + child->type + "\"> cannot be inside a shapegroup; take it out");
    ShapePart part;
    if (!parse_part(builder, *child, part)) continue;
    if (part.emitter)
      throw Error(part.emitter->where, "shapes inside a shapegroup cannot emit light; place the light by itself");
    parts.push_back(std::move(part));
  }
  properties.finish();
  return builder.groups[&node] = std::move(parts);
}

void build_instance(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  const DAffine to_world = properties.transform("to_world");
  const SceneNode* group = properties.object("shape");
  if (!group || group->type != "shapegroup")
    throw Error(node.where, "<shape type=\"instance\"> needs a <ref> to one shapegroup");
  require_invertible(to_world, properties.where("to_world"));
  for (const ShapePart& part : build_group(builder, *group)) {
    const DAffine composed = compose(to_world, part.to_world);
    require_invertible(composed, properties.where("to_world"));
    add_instance(builder, part, node.id.empty() ? part.id : node.id, composed, properties.where("to_world"));
  }
  properties.finish();
}

}  // namespace

void build_shape(SceneBuilder& builder, const SceneNode& node) {
  if (node.type == "shapegroup") {
    build_group(builder, node);
    return;
  }
  if (node.type == "instance") {
    build_instance(builder, node);
    return;
  }
  ShapePart part;
  if (!parse_part(builder, node, part)) return;
  // Spheres, rectangles and disks are sampled better than what they are scaled or sheared to.
  const ShapeKind kind = builder.scene.shapes[part.shape].kind;
  const bool is_round_or_square = kind == ShapeKind::sphere || kind == ShapeKind::rectangle || kind == ShapeKind::disk;
  if (part.emitter && is_round_or_square) part.to_world = without_digits_lost(part.to_world);
  const uint32_t index = add_instance(builder, part, part.id, part.to_world, part.where);
  if (!part.emitter) return;
  // An area that underflows in single precision cannot be sampled either.
  if (!(surface_area(builder.scene.shapes[part.shape], part.to_world) >= double(std::numeric_limits<float>::min())))
    throw Error(part.emitter->where, "the area light's shape has no area; make it larger or remove the light");
  build_area_light(builder, *part.emitter, index);
}

}  // namespace fieldtrace
