// Geometry of scene files' shapes: mesh files and built-in kinds (build_geometry() of scene_builder.h).

#include "core/loader/scene_builder.h"
#include "core/loader/scene_transforms.h"
#include "core/math/frame.h"
#include "core/mesh/mesh_io.h"

namespace fieldtrace {
namespace {

// The index of the shape with this key; `make` builds it on first use.
template <typename Make>
uint32_t share_shape(SceneBuilder& builder, const std::string& key, const Make& make) {
  const auto known = builder.shapes.find(key);
  if (known != builder.shapes.end()) return known->second;
  builder.scene.shapes.push_back(make());
  return builder.shapes[key] = uint32_t(builder.scene.shapes.size() - 1);
}

Shape make_analytic(ShapeKind kind, const char* name, const Vec3& lower, const Vec3& upper) {
  Shape shape;
  shape.kind = kind;
  shape.name = name;
  shape.bounds = {lower, upper};
  return shape;
}

Shape make_rectangle() {
  Shape shape;
  shape.kind = ShapeKind::rectangle;
  shape.name = "rectangle";
  for (const Vec2& corner : {Vec2(-1, -1), Vec2(1, -1), Vec2(1, 1), Vec2(-1, 1)}) {
    shape.mesh.positions.emplace_back(corner, 0.0f);
    shape.mesh.normals.emplace_back(0.0f, 0.0f, 1.0f);
    shape.mesh.texcoords.push_back(0.5f * corner + 0.5f);
  }
  shape.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  shape.bounds = shape.mesh.bounds();
  return shape;
}

// Each face has separate vertices, with (u, v) as on Mitsuba's cube: the axes along which u and v grow.
Shape make_cube() {
  Shape shape;
  shape.kind = ShapeKind::mesh;
  shape.name = "cube";
  constexpr float axes[6][2][3] = {{{0, 0, 1}, {1, 0, 0}}, {{-1, 0, 0}, {0, 0, -1}}, {{0, 1, 0}, {0, 0, -1}},
                                   {{0, 1, 0}, {1, 0, 0}}, {{0, 1, 0}, {0, 0, 1}},   {{0, -1, 0}, {1, 0, 0}}};
  TriangleMesh& mesh = shape.mesh;
  for (const auto& face : axes) {
    const Vec3 u(face[0][0], face[0][1], face[0][2]), v(face[1][0], face[1][1], face[1][2]);
    const Vec3 normal = glm::cross(v, u);
    const uint32_t first = uint32_t(mesh.positions.size());
    for (const Vec2& uv : {Vec2(0, 1), Vec2(1, 1), Vec2(1, 0), Vec2(0, 0)}) {
      mesh.positions.push_back(normal + u * (2 * uv.x - 1) + v * (2 * uv.y - 1));
      mesh.normals.push_back(normal);
      mesh.texcoords.push_back(uv);
    }
    mesh.triangles.emplace_back(first, first + 1, first + 2);
    mesh.triangles.emplace_back(first, first + 2, first + 3);
  }
  shape.bounds = mesh.bounds();
  return shape;
}

// Whether the mesh is shaded with normals from its file. Only mirrored meshes need to know, so reading the file again
// is acceptable.
bool has_own_normals(SceneBuilder& builder, const std::string& path, MeshLoadOptions options) {
  if (options.face_normals) return false;
  const auto known = builder.own_normals.find(path);
  if (known != builder.own_normals.end()) return known->second;
  options.compute_normals = false;
  return builder.own_normals[path] = !load_mesh(path, options).normals.empty();
}

// Mitsuba transforms plain meshes before it derives normals from their winding, so a mirroring to_world turns those
// inside out; normals from the file and those of built-in shapes follow the surface.
void load_mesh_file(SceneBuilder& builder, const SceneNode& node, Properties& properties, ShapePart& part) {
  const std::string filename = properties.string("filename", "");
  if (filename.empty()) throw Error(node.where, "<shape type=\"" + node.type + "\"> lacks its filename");
  const std::string path = builder.input_file(node, filename);
  MeshLoadOptions options;
  options.format = node.type == "obj" ? MeshFormat::obj : MeshFormat::ply;
  options.face_normals = properties.boolean("face_normals", false);
  options.compute_normals = true;
  if (properties.has("flip_tex_coords")) options.flip_tex_coords = properties.boolean("flip_tex_coords", false);
  const std::string flip = !options.flip_tex_coords ? "unset" : *options.flip_tex_coords ? "yes" : "no";
  const std::string key = node.type + (options.face_normals ? " flat " : " smooth ") + flip + " " + path;
  part.shape = share_shape(builder, key, [&] {
    Shape shape;
    shape.kind = ShapeKind::mesh;
    shape.name = filename;
    shape.mesh = load_mesh(path, options, builder.diagnostics.sink);
    shape.bounds = shape.mesh.bounds();
    return shape;
  });
  if (is_mirrored(part.to_world) && !has_own_normals(builder, path, options)) part.flip_normals = !part.flip_normals;
}

void fold_sphere(SceneBuilder& builder, Properties& properties, ShapePart& part) {
  const DVec3 centre = properties.point("center", DVec3(0.0));
  const double radius = properties.number("radius", 1.0, k_positive);
  // Mitsuba's spheres turn inside out under a mirroring to_world.
  if (is_mirrored(part.to_world)) part.flip_normals = !part.flip_normals;
  part.to_world = compose(part.to_world, compose(translation(centre), scaling(DVec3(radius))));
  part.shape = share_shape(builder, "sphere",
                           [] { return make_analytic(ShapeKind::sphere, "sphere", Vec3(-1.0f), Vec3(1.0f)); });
}

void fold_cylinder(SceneBuilder& builder, const SceneNode& node, Properties& properties, ShapePart& part) {
  const DVec3 p0 = properties.point("p0", DVec3(0.0)), p1 = properties.point("p1", DVec3(0.0, 0.0, 1.0));
  const double radius = properties.number("radius", 1.0, k_positive), length = glm::length(p1 - p0);
  if (!(length > 0)) throw Error(node.where, "the cylinder has no length; give p0 and p1 that differ");
  const DMat3 frame = basis_about((p1 - p0) / length);
  part.to_world = compose(part.to_world, DAffine(frame[0] * radius, frame[1] * radius, frame[2] * length, p0));
  part.shape = share_shape(builder, "cylinder", [] {
    return make_analytic(ShapeKind::cylinder, "cylinder", Vec3(-1.0f, -1.0f, 0.0f), Vec3(1.0f));
  });
}

}  // namespace

bool build_geometry(SceneBuilder& builder, const SceneNode& node, Properties& properties, ShapePart& part) {
  if (node.type == "obj" || node.type == "ply") {
    load_mesh_file(builder, node, properties, part);
  } else if (node.type == "rectangle") {
    part.shape = share_shape(builder, "rectangle", make_rectangle);
  } else if (node.type == "cube") {
    part.shape = share_shape(builder, "cube", make_cube);
  } else if (node.type == "disk") {
    part.shape = share_shape(builder, "disk", [] {
      return make_analytic(ShapeKind::disk, "disk", Vec3(-1.0f, -1.0f, 0.0f), Vec3(1.0f, 1.0f, 0.0f));
    });
  } else if (node.type == "sphere") {
    fold_sphere(builder, properties, part);
  } else if (node.type == "cylinder") {
    fold_cylinder(builder, node, properties, part);
  } else {
    builder.diagnostics.unknown(node.where, "unknown shape type '" + node.type + "', left out");
    return false;
  }
  return true;
}

}  // namespace fieldtrace
