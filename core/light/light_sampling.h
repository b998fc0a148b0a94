// Lights prepared for sampling, and the shadow rays from a batch of shading points to one of them.
//
// The kinds of light and how each is sampled: light.hd.h, light_shapes.hd.h, light_shapes_area.hd.h.
// Emission is one-sided, on the side of the instance's normal: the shape's normal under the inverse transpose of
// to_world, reversed by Instance::flip_normals. (A mirroring transform alone reverses nothing: where the scene format
// demands it, the loader sets flip_normals.) Meshes use the geometric normal, (p1-p0) x (p2-p0).
// Every instruction set gives the same bits.
// Thread-safety: make_lights runs on one thread; all else is const and may be used from any number of threads.
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

// lights[i] belongs to Scene::emitters[i], including those that cannot be sampled (kind none).
struct LightTable {
  std::vector<Light> lights;
  std::vector<LightTriangle> triangles;  // of all mesh lights
  EnvironmentTable environment;          // of the only light of that kind
  AlignedVector<int32_t> point_sets;     // make_point_sets()

  size_t size() const { return lights.size(); }
};

// Precomputes every emitter of the scene. Throws Error if an area light names no instance, if a mesh that glows has
// more than 2^26 triangles, if an environment's map is not valid for make_environment, or if there are two
// environments.
LightTable make_lights(const Scene& scene);

// Fills `out` (resized to shading_points.size * light_samples) with one shadow ray per shading point and sample towards
// light `light`; see ShadowBatch for the members. Sample k of shading point r is point shading_points.sample[r] *
// light_samples + k of the scrambled Sobol sequence of shading_points.seed[r] and the light (point_sets.h; the third
// number of mesh lights: sobol.hd.h).
//
// A ray starts at the shading point, moved along the geometric normal, to the side that the ray leaves on, by
// shading_points.error plus a bound on the rounding of that sum. Sampled densities are those seen from there (for
// shading points that transmit: from the point itself). The end is moved off the light by its error bound
// (Light::error_base and error_slope), so that t in [0, tmax] never hits the light itself. Shading points closer to the
// light than that receive none of its light. Unchecked: light < lights.size(), light_samples >= 1, finite shading
// points, shading_points.size * light_samples < 2^31. Throws UsageError if this processor cannot run `isa`.
void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points, int light_samples,
                  Isa isa, ShadowBatch& out);
// The same for a range of the samples: slot r * range.count + k is sample range.first + k of range.total.
void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                  const LightSampleRange& range, Isa isa, ShadowBatch& out);

// Radiance of a light that a ray meets (on the side that emits). `direction` is the ray's, in world space, of any
// length but 0; it matters for environments only.
Rgb emitted_radiance(const LightTable& lights, uint32_t index, const Vec3& direction);

// Where a ray that was not sampled from the light hits it. World space.
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

// Whether all samples from one point have the same density (sphere seen from outside, rectangle) or there is only one
// sample (point, directional). Sampling the BSDF of a diffuse surface gains nothing for such lights.
bool sampled_in_closed_form(const Light& light);

}  // namespace fieldtrace
