// The surface at a ray's hit: position with an error bound, normals, texture coordinates, tangent.
//
// The position is recomputed from the primitive in double precision (triangles: from barycentric coordinates; analytic
// shapes: by projection onto them) and rounded once, so its error does not grow with the ray's length. The bound covers
// that rounding and those of the *next* ray: of its origin, of its transform into object space, and of the intersection
// test there (after Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th ed., section 6.8, "Managing Rounding
// Error"; Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013). Normals are transformed by
// the inverse transpose of the instance's transform, mirrored or not, as in Mitsuba; flip_normals reverses both.
// Thread-safety: pure functions of a const scene.
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "core/trace/rays.h"

namespace fieldtrace {

// World space. Normals are unit and point to the surface's outside, not towards the ray.
struct SurfacePoint {
  Vec3 position = Vec3(0.0f);
  // An origin moved by this distance along the geometric normal, either way, lies strictly on that side of the surface
  // as ray queries see it.
  float error = 0.0f;
  Vec3 geometric_normal = Vec3(0.0f, 0.0f, 1.0f);
  Vec3 shading_normal = Vec3(0.0f, 0.0f, 1.0f);
  Vec2 uv = Vec2(0.0f);
  uint32_t instance = k_none, primitive = k_none;
};

// Surfaces as structures of arrays, padded like RayBatch, without what their hits tell; see SurfacePoint.
struct SurfaceBatch {
  AlignedVector<float> px, py, pz;  // position
  AlignedVector<float> gx, gy, gz;  // geometric normal
  AlignedVector<float> sx, sy, sz;  // shading normal
  AlignedVector<float> error;
  std::vector<Vec2> uv;

  // As RayBatch::resize().
  void resize(size_t n) {
    for (auto* v : {&px, &py, &pz, &gx, &gy, &gz, &sx, &sy, &sz, &error}) make_room(*v, padded(n));
    make_room(uv, n);
  }
  void set(size_t i, const SurfacePoint& s) {
    px[i] = s.position.x, py[i] = s.position.y, pz[i] = s.position.z;
    gx[i] = s.geometric_normal.x, gy[i] = s.geometric_normal.y, gz[i] = s.geometric_normal.z;
    sx[i] = s.shading_normal.x, sy[i] = s.shading_normal.y, sz[i] = s.shading_normal.z;
    error[i] = s.error;
    uv[i] = s.uv;
  }
  // `hits`: where the surfaces were found.
  SurfacePoint at(const HitBatch& hits, size_t i) const {
    return {{px[i], py[i], pz[i]}, error[i],         {gx[i], gy[i], gz[i]}, {sx[i], sy[i], sz[i]}, uv[i],
            hits.instance[i],      hits.primitive[i]};
  }
};

// The surface at hit `i` of `hits`, found by ray `i` of `rays`. Unchecked: the caller guarantees a hit there.
SurfacePoint surface_at(const Scene& scene, const RayBatch& rays, const HitBatch& hits, size_t i);

// Texture coordinates at the barycentric coordinates (u, v) of vertices 1 and 2. `shape` is_meshed().
Vec2 triangle_uv(const Shape& shape, uint32_t primitive, float u, float v);

// The surface of a mesh instance at a position that is within `error` of it along the unit `normal`, which replaces the
// surface's normal and may point to either side; `primitive` is a nearby triangle, whose texture coordinates are
// extrapolated over its plane. For surfaces known from fields (hybrid/glossy/hit_answerer.h). Unchecked: the instance
// is a mesh's.
SurfacePoint surface_near(const Scene& scene, uint32_t instance, uint32_t primitive, const Vec3& position,
                          const Vec3& normal, float error);

// The derivative of the position with respect to u (world space, any length), which orients anisotropic roughness; of a
// mesh without texture coordinates to the first barycentric coordinate. Zero where texture coordinates define none.
Vec3 surface_tangent(const Scene& scene, const SurfacePoint& surface);

// The origin from which a ray in direction d leaves the surface without hitting it again: moved by `error` along the
// geometric normal to the side of d.
Vec3 offset_origin(const Vec3& position, const Vec3& geometric_normal, float error, const Vec3& d);

}  // namespace fieldtrace
