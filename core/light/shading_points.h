// Shading points that gather light and their shadow rays: one batch per group of points and light.
//
// Memory layout: structures of arrays, padded like RayBatch or longer; ray slot r * light_samples + k belongs to
// shading point r. Thread-safety: values.
#pragma once

#include <algorithm>
#include <span>

#include "core/light/light.hd.h"
#include "core/trace/rays.h"

namespace fieldtrace {

// World space. The geometric normal g and shading normal s are unit and lie on the side of the arriving ray.
struct ShadingPointBatch {
  size_t size = 0;
  AlignedVector<float> px, py, pz;
  AlignedVector<float> gx, gy, gz;
  AlignedVector<float> sx, sy, sz;
  // Bound on the distance between the computed point and the true surface, along g (world units).
  AlignedVector<float> error;
  AlignedVector<float> radius;       // of the cluster of points that this one stands for; 0: a single point
  AlignedVector<uint32_t> seed;      // of the pixel and path vertex: the light's dimensions are derived from it
  AlignedVector<uint32_t> sample;    // the camera sample's index in the pixel: light sample k has sequence index
                                     // sample * light_samples + k
  AlignedVector<uint32_t> instance;  // the instance that the point lies on
  AlignedVector<uint8_t> transmits;  // 1: directions below the surface carry light too (not opaque)

  // As RayBatch::resize().
  void resize(size_t n) {
    size = n;
    for_arrays(*this, [n](auto& values, const auto&) { make_room(values, padded(n)); });
  }
  Vec3 position(size_t i) const { return {px[i], py[i], pz[i]}; }
  Vec3 geometric_normal(size_t i) const { return {gx[i], gy[i], gz[i]}; }
  Vec3 shading_normal(size_t i) const { return {sx[i], sy[i], sz[i]}; }
  // Entry i becomes entry j of `from`.
  void copy(size_t i, const ShadingPointBatch& from, size_t j) {
    for_arrays(from, [=](auto& to, const auto& of) { to[i] = of[j]; });
  }
  // Entries [i, i + count) become those of `from` from j on.
  void copy(size_t i, const ShadingPointBatch& from, size_t j, size_t count) {
    for_arrays(from, [=](auto& to, const auto& of) { std::copy_n(of.data() + j, count, to.data() + i); });
  }

 private:
  // Calls f(values, others) with each array and that of `from`.
  template <class F>
  void for_arrays(const ShadingPointBatch& from, const F& f) {
    f(px, from.px), f(py, from.py), f(pz, from.pz);
    f(gx, from.gx), f(gy, from.gy), f(gz, from.gz);
    f(sx, from.sx), f(sy, from.sy), f(sz, from.sz);
    f(error, from.error), f(radius, from.radius);
    f(seed, from.seed), f(sample, from.sample), f(instance, from.instance);
    f(transmits, from.transmits);
  }
};

// `chosen` becomes the entries `indices` of `all`.
inline void copy_points(const ShadingPointBatch& all, std::span<const uint32_t> indices, ShadingPointBatch& chosen) {
  chosen.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) chosen.copy(i, all, indices[i]);
}

struct LightTable;

// How rays were made, for devices that make them themselves: slot r * range.count + k is that of shading point r.
// lights == null: in another way.
struct LightRaySource {
  const LightTable* lights = nullptr;
  uint32_t light = 0;
  const ShadingPointBatch* points = nullptr;
  LightSampleRange range = {};
  const uint32_t* slots = nullptr;  // the slot that each ray was copied from; null: they are all there, in order
};

struct ShadowBatch {
  // From the offset point towards the light sample. d reaches from the origin to the sample, so t = 1 there, and tmax
  // is smaller by the light's error bound. Lights at infinity: d is unit, tmax infinite. Slots whose sample cannot
  // contribute (below the horizon, behind the light) are inactive: tmax < 0, weight 0.
  RayBatch rays;
  size_t active = 0;                      // active slots, counted by sample_light
  LightRaySource source;                  // by sample_light; good while its shading points are as they were
  AlignedVector<float> weight;            // |cos at the shading normal| / pdf of the direction (solid angle); for point
                                          // and directional emitters |cos| times the geometric fall-off
  AlignedVector<float> pdf;               // solid-angle density, for multiple importance sampling; 0 for delta emitters
  AlignedVector<uint32_t> cell;           // of the sample in the grid of LightSampleRange::cell_columns
  AlignedVector<float> red, green, blue;  // environments only: the map's radiance there, to multiply Light::value
  AlignedVector<uint32_t> instance;       // of the shading point, per slot
  AlignedVector<uint8_t> blocked;         // result of rays: 1 if occluded
  AlignedVector<uint8_t> exact;           // result: 1 if an exact ray decided the slot
  AlignedVector<float> clear;             // of strata, and what reflected_light() reads: the visible share, [0, 1]

  void resize(size_t n) {
    rays.resize(n);
    weight.resize(padded(n));
    pdf.resize(padded(n));
    instance.resize(padded(n), 0xffffffffu);
    blocked.assign(padded(n), 0);
    clear.assign(padded(n), 1.0f);
    exact.assign(padded(n), 0);
    source = {};
  }
};

}  // namespace fieldtrace
