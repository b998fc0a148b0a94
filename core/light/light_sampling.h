// Lights ready for sampling, and the shadow rays of a batch of shading points towards one of them.
//
// Which kinds there are and how each is sampled: light.hd.h, light_shapes.hd.h, light_shapes_area.hd.h.
// Emission is one-sided: on the side of the instance's normal, which is the shape's normal under the inverse transpose
// of to_world, turned around by Instance::flip_normals. (A mirroring transform turns nothing by itself: where the scene
// format says that it does, the loader sets flip_normals.) For meshes it is the geometric normal, (p1-p0) x (p2-p0).
// Every instruction set gives the same bits.
// Thread-safety: make_lights builds on one thread; all else is const and may run on any number of threads.
#pragma once

#include <cstdint>
#include <vector>

#include "core/light/light.hd.h"
#include "core/light/light_environment.h"
#include "core/light/shading_points.h"
#include "core/sampling/point_sets.h"
#include "core/scene/scene.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// lights[i] belongs to Scene::emitters[i] (also where it cannot be sampled: kind none).
struct LightTable {
  std::vector<Light> lights;
  std::vector<LightTriangle> triangles;  // of all mesh lights
  EnvironmentTable environment;          // of the only light of that kind
  AlignedVector<int32_t> point_sets;     // make_point_sets()

  size_t size() const { return lights.size(); }
};

// Precomputes every emitter of the scene. Throws Error if an area light names no instance, an environment no map that
// make_environment takes, or if there are two environments.
LightTable make_lights(const Scene& scene);

// Which of each shading point's samples a batch holds: numbers first ... first + count - 1 of `total`. columns > 0:
// instead of a sequence's points, the centres of the cells of a grid of that many columns and total / columns rows
// (which must be whole; total >= 2), row by row, moved away from the middle of the light by the factor `stretch`: with
// n columns and rows and little less than n / (n - 1) a lattice from edge to edge of the square (of which all points
// must lie within). Not for mesh lights. x, y: instead of either, one point of [-1, 1]^2 for each shading point (total
// = count = 1), as many numbers as the shading points' own vectors hold, padding included. Not for mesh lights.
struct LightSampleRange {
  int total = 1, first = 0, count = 1;
  int columns = 0;
  float stretch = 1.0f;
  const float *x = nullptr, *y = nullptr;
};

// Fills `out` (resized to shading points.size * light_samples) with one shadow ray per shading point and sample towards
// light `light`; the meaning of each member is at ShadowBatch. Sample k of shading point r is point shading
// points.sample[r] * light_samples + k of the scrambled Sobol sequence of shading points.seed[r] and the light
// (point_sets.h; the third number of mesh lights: sobol.hd.h).
//
// The ray starts at the point moved by shading points.error along the geometric normal to the side that the ray leaves
// on, plus a bound on the rounding of that sum. The sampled densities are those seen from there (for shading points
// that transmit: from the point itself). Its end has been moved off the light by Light::error_base, so t in [0, tmax]
// never meets the light itself. Shading points closer to the light than that see nothing of it. Unchecked: light <
// lights.size(), light_samples >= 1, finite shading points, shading points.size * light_samples < 2^31. Throws
// UsageError if this processor cannot run `isa`.
void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points, int light_samples,
                  Isa isa, ShadowBatch& out);
// The same for some of the samples: slot r * range.count + k is sample range.first + k of range.total.
void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                  const LightSampleRange& range, Isa isa, ShadowBatch& out);

// Radiance of a light that a ray meets (on the side that emits). `direction` is the ray's, in world space, of any
// length but 0; it matters for environments only.
Rgb emitted_radiance(const LightTable& lights, uint32_t index, const Vec3& direction);

// Where a ray that was not sampled from the light meets it. World space.
struct LightHit {
  float t = 0;                           // along the (unnormalised) direction; lights at infinity: unused
  Vec3 normal = Vec3(0.0f, 0.0f, 1.0f);  // unit geometric normal at the hit, on either side
  uint32_t primitive = 0;                // mesh lights: the triangle
};

// The solid-angle density (1/sr) with which sample_light chooses `direction` from `from` (the ray's origin), for
// multiple importance sampling; 0 where it never would: behind the light, point and directional lights, and for
// constant lights below the shading normal of shading points that do not transmit. The geometric horizon is not
// considered. `direction` need not be unit. Unchecked: a finite direction other than zero.
float light_pdf(const LightTable& lights, uint32_t index, const Vec3& from, const Vec3& shading_normal, bool transmits,
                const Vec3& direction, const LightHit& hit);

// Whether every sample has the same density from one point (sphere seen from outside, rectangle) or is the only one
// (point, directional): sampling the BSDF of a diffuse surface for such a light gains nothing.
bool sampled_in_closed_form(const Light& light);

}  // namespace fieldtrace
