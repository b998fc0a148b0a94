// The interface through which the thesis' pipeline finds hits and shadows, in fields or with Embree. Everything else is
// shared by the two.
//
// Thread-safety: tracers are const and may be used from any number of threads; batches belong to one thread.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/simd/isa.h"
#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/thesis/thesis_field.h"
#include "field/thesis/thesis_kernels.h"
#include "tools/thesis/scene.h"

namespace fieldtrace {

// A surface hit by a ray of a batch, world space. instance k_none: a miss.
struct PhongSurface {
  Vec3 position = Vec3(0.0f);
  Vec3 normal = Vec3(0.0f, 0.0f, 1.0f);     // unit, on the ray's side
  Vec3 geometric = Vec3(0.0f, 0.0f, 1.0f);  // the triangle's, on the ray's side; a field gives `normal` again
  float error = 0.0f;  // offset along `geometric` for exact rays that leave (core/surface/surface.h)
  uint32_t instance = k_none;
};

struct TracerBatch {
  RayBatch rays;
  AlignedVector<uint32_t> skip;  // padded: the instance that the ray leaves, or k_none
  std::vector<PhongSurface> surfaces;
  // Shadows: indices of the surfaces to test, and the result for each (1: the light is occluded).
  std::vector<uint32_t> shading_points;
  AlignedVector<uint32_t> hidden;
  // Working memory of the tracer.
  ThesisHits field_hits;
  HitBatch exact_hits;
  RayBatch shadow_rays;
  RayStates states;
  std::vector<uint8_t> blocked;
  std::vector<uint32_t> indices;
};

class PhongTracer {
 public:
  virtual ~PhongTracer() = default;
  // Fills batch.surfaces for batch.rays (unit directions).
  virtual void nearest(TracerBatch& batch, bool primary) const = 0;
  // Fills batch.hidden for batch.shading_points and one light.
  virtual void shadow(TracerBatch& batch, const Vec3& light) const = 0;
};

// fields: one per shape of the scene, which several instances may share. All must outlive the tracer.
std::unique_ptr<PhongTracer> make_field_tracer(const PhongScene& scene, const std::vector<const ThesisField*>& fields,
                                               Isa isa = Isa::automatic);
std::unique_ptr<PhongTracer> make_exact_tracer(const PhongScene& scene, const Accel& accel);

}  // namespace fieldtrace
