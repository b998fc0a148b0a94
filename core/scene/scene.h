// The scene as plain data: shapes, instances, materials, emitters, camera, film. Loaders fill it; the
// acceleration structure, the renderers and the fields only read it.
//
// Space: shapes live in object space, everything else in (re-centred) world space.
// Memory layout: arrays of plain structs that refer to one another by index.
// Thread-safety: built by one thread, then const for any number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/math/math.h"
#include "core/mesh/mesh.h"
#include "core/scene/camera_lens.h"

namespace fieldtrace {

inline constexpr uint32_t k_none = 0xffffffffu;

// ---------------------------------------------------------------- textures

// Linear RGB pixels, row 0 (the top of the image) at v = 0, as Mitsuba reads bitmaps.
struct Bitmap {
  int width = 0, height = 0;
  std::vector<Rgb> pixels;  // width * height, row-major from the top
};

enum class TextureKind : uint8_t { constant, checkerboard, bitmap };
enum class WrapMode : uint8_t { repeat, mirror, clamp };
enum class TextureFilter : uint8_t { nearest, bilinear };

struct Texture {
  TextureKind kind = TextureKind::constant;
  Rgb color0 = Rgb(0.5f);  // the constant, or the checkerboard's first colour
  Rgb color1 = Rgb(0.2f);
  // uv' = uv_transform * (u, v, 1); Mitsuba's `to_uv`.
  glm::mat3x2 uv_transform = glm::mat3x2(1.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f);
  WrapMode wrap = WrapMode::repeat;
  TextureFilter filter = TextureFilter::bilinear;
  uint32_t bitmap = k_none;  // index into Scene::bitmaps
};

// ---------------------------------------------------------------- materials

enum class BsdfKind : uint8_t {
  diffuse,
  conductor,
  rough_conductor,
  dielectric,
  rough_dielectric,
  thin_dielectric,
  plastic,
  rough_plastic,
  principled
};
// Whether surfaces of this kind transmit light.
inline bool transmits(BsdfKind kind) {
  return kind == BsdfKind::dielectric || kind == BsdfKind::rough_dielectric || kind == BsdfKind::thin_dielectric;
}
// Whether surfaces of this kind are a diffuse body under an interface.
inline bool is_plastic(BsdfKind kind) { return kind == BsdfKind::plastic || kind == BsdfKind::rough_plastic; }
// Whether surfaces of this kind have a lobe of finite width about the mirrored or refracted direction.
inline bool is_rough(BsdfKind kind) {
  return kind == BsdfKind::rough_conductor || kind == BsdfKind::rough_dielectric || kind == BsdfKind::rough_plastic ||
         kind == BsdfKind::principled;
}
enum class MicrofacetKind : uint8_t { beckmann, ggx };

// Hemispherical transmittance of a rough interface for one distribution and index; see rough_transmittance.h.
struct RoughTransmittance {
  static constexpr int k_nodes = 64;
  std::array<float, k_nodes> outside = {};  // from outside, at cosines i / (k_nodes - 1)
  float internal_reflectance = 0.0f;        // of diffuse light from inside
  float grazing = 0.0f;                     // CoatedBody::grazing
};
// Interfaces of more have a transmittance that CoatedBody does not fit: it falls too soon.
inline constexpr float k_most_grazing = 1.5f;

// Whether a surface is a diffuse body under an interface that CoatedBody (core/material/bsdf.h) fits. `rough`: of rough
// plastics, their interface's.
inline bool is_coated_diffuse(BsdfKind kind, float relative_ior, const RoughTransmittance* rough) {
  if (kind == BsdfKind::plastic) return relative_ior >= 1.0f;  // none is reflected wholly from outside
  return kind == BsdfKind::rough_plastic && rough->grazing <= k_most_grazing;
}

// Every texture index refers to Scene::textures and is valid, except that `opacity` may be k_none.
struct Bsdf {
  std::string id;  // the scene file's id, may be empty
  BsdfKind kind = BsdfKind::diffuse;
  bool two_sided = false;
  uint32_t back = k_none;              // two-sided: another Bsdf for the back side; k_none: the same on both sides
  uint32_t opacity = k_none;           // mask: the share that does not pass straight through; k_none: all of it
  uint32_t reflectance = 0;            // diffuse: albedo; principled: base_color; others: specular_reflectance
  uint32_t transmittance = 0;          // dielectrics: specular_transmittance
  uint32_t diffuse_reflectance = 0;    // plastics
  bool nonlinear = false;              // plastics: whether internal reflections shift colours
  Rgb eta = Rgb(0.0f), k = Rgb(1.0f);  // conductors: complex index of refraction, relative to ext_eta
  float int_ior = 1.5046f, ext_ior = 1.000277f;          // all others but diffuse (Mitsuba's defaults: bk7 and air)
  MicrofacetKind microfacet = MicrofacetKind::beckmann;  // rough kinds and principled
  float alpha_u = 0.1f, alpha_v = 0.1f;
  uint32_t rough_transmittance = k_none;  // rough plastic: index into Scene::rough_transmittances
  // Principled:
  float roughness = 0.5f, metallic = 0.0f, clearcoat = 0.0f, clearcoat_alpha = 0.1f;
};

// ---------------------------------------------------------------- shapes

// Rectangle: [-1,1]^2 in z = 0, normal +z, also stored as two triangles in `mesh`. Cube: [-1,1]^3 as triangles. The
// analytic kinds have no mesh. Sphere: unit sphere about the origin. Disk: unit disk in z = 0, normal +z. Cylinder:
// radius 1 about the z axis from z = 0 to z = 1, open at both ends, outward normals.
enum class ShapeKind : uint8_t { mesh, rectangle, sphere, disk, cylinder };
inline bool is_meshed(ShapeKind kind) { return kind == ShapeKind::mesh || kind == ShapeKind::rectangle; }

struct Shape {
  ShapeKind kind = ShapeKind::mesh;
  std::string name;   // file name or kind, for messages and statistics
  TriangleMesh mesh;  // kinds mesh and rectangle
  Bounds3 bounds;     // object space

  size_t triangle_count() const { return mesh.triangles.size(); }
};

struct Instance {
  std::string id;
  uint32_t shape = 0;  // index into Scene::shapes
  uint32_t bsdf = 0;   // index into Scene::bsdfs
  uint32_t emitter = k_none;
  bool flip_normals = false;  // both geometric and shading normals are reversed
  Affine to_world = Affine(1.0f);
  Affine to_object = Affine(1.0f);  // inverse of to_world, computed in double
};

// ---------------------------------------------------------------- emitters

enum class EmitterKind : uint8_t { area, constant, environment, point, directional };
// Whether emitters of this kind surround the scene.
inline bool is_sky(EmitterKind kind) { return kind == EmitterKind::constant || kind == EmitterKind::environment; }

struct Emitter {
  EmitterKind kind = EmitterKind::area;
  // area: radiance (W m^-2 sr^-1, emitted on the side of the normal); constant: radiance; environment: factor of the
  // map's radiance; point: intensity (W sr^-1); directional: irradiance on a facing plane (W m^-2).
  Rgb value = Rgb(1.0f);
  uint32_t instance = k_none;               // area: the emitting instance
  Vec3 position = Vec3(0.0f);               // point
  Vec3 direction = Vec3(0.0f, 0.0f, 1.0f);  // directional: unit direction of propagation
  uint32_t bitmap = k_none;                 // environment: the map, an index into Scene::bitmaps
  Mat3 rotation = Mat3(1.0f);               // environment: orthonormal columns, the map's axes in world space
};

// ---------------------------------------------------------------- camera, film, settings

// Mitsuba's convention: the camera looks along +z of its local frame, +y is up, +x is *left* in the image.
struct Camera {
  Affine to_world = Affine(1.0f);  // rigid up to a uniform scale; no shear
  float fov_x_degrees = 39.3f;     // horizontal field of view, resolved from fov and fov_axis
  Vec2 principal_offset = Vec2(0.0f);
  float near_clip = 1e-2f, far_clip = 1e4f;
  float aperture_radius = 0.0f;  // 0: pinhole
  float focus_distance = 1.0f;
};

// Pixel rectangle, x to the right and y down.
struct Rect {
  int x = 0, y = 0, width = 0, height = 0;
};

// Whether `inner` is not empty and lies within `outer`.
constexpr bool is_inside(const Rect& inner, const Rect& outer) {
  return inner.width >= 1 && inner.height >= 1 && inner.x >= outer.x && inner.y >= outer.y &&
         int64_t(inner.x) + inner.width <= int64_t(outer.x) + outer.width &&
         int64_t(inner.y) + inner.height <= int64_t(outer.y) + outer.height;
}

struct Film {
  int width = 768, height = 576;
  Rect crop;  // always set; the whole film by default
  FilterKind filter = FilterKind::gaussian;
  float filter_radius = 2.0f;  // pixels
  float gaussian_stddev = 0.5f;
};

struct IntegratorSettings {
  int max_depth = -1;  // -1: no limit. 1: only emission seen directly; 2: direct light
  int rr_depth = 5;    // path length from which Russian roulette applies
  bool hide_emitters = false;
};

struct Scene {
  std::vector<Bitmap> bitmaps;
  std::vector<Texture> textures;
  std::vector<Bsdf> bsdfs;
  std::vector<RoughTransmittance> rough_transmittances;
  std::vector<Shape> shapes;
  std::vector<Instance> instances;
  std::vector<Emitter> emitters;
  Camera camera;
  Film film;
  IntegratorSettings integrator;
  int sample_count = 16;  // of the scene file's sampler
  uint32_t seed = 0;
  std::map<std::string, std::string> parameters;  // that the scene file was read with, by name
  std::vector<std::string> files;  // all files read for the scene: scene files, meshes, bitmaps; with repetitions
  // World coordinates of the file = coordinates used here + origin. Not zero where the scene lies far from the file's
  // origin compared with its size (see scene_recentre.h).
  DVec3 origin = DVec3(0.0);

  size_t triangle_count() const;  // counted over instances
  Bounds3 world_bounds() const;
};

}  // namespace fieldtrace
