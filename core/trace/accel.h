// The acceleration structure. The sources of core/trace are the only code that uses Embree: this one and
// accel_analytic.cpp for the renderer, user_geometry.cpp for Embree scenes of other programs.
//
// Each shape has a separate Embree scene in object space; the whole scene is a scene of instances of those. All queries
// take batches and use the packet width and flags that measured fastest for that kind of ray. The result for a ray does
// not depend on the other rays of its batch or on its position in it: hybrid rendering compacts rays and must get the
// same bits.
// Thread-safety: construction uses TBB; queries are const and may run from any number of threads.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "core/scene/scene.h"
#include "core/trace/rays.h"

namespace fieldtrace {

// How coherent the rays of a batch are: camera rays of a tile, or rays in all directions.
enum class Coherence { coherent, incoherent };

// A shape's hit in object space, for field baking. t < 0: a miss. The normal is geometric and not normalised.
struct ShapeHits {
  AlignedVector<float> t, nx, ny, nz;
  AlignedVector<uint32_t> primitive;

  void resize(size_t n) {
    for (auto* a : {&t, &nx, &ny, &nz}) a->resize(padded(n));
    primitive.resize(padded(n));
  }
};

class Accel {
 public:
  // Builds everything. Throws Error if Embree cannot build (out of memory). `scene` must outlive the object.
  explicit Accel(const Scene& scene);
  ~Accel();
  Accel(const Accel&) = delete;
  Accel& operator=(const Accel&) = delete;

  // Nearest hits of the whole scene, world space. `hits` is resized by the caller; its padding is written, too.
  void intersect(const RayBatch& rays, HitBatch& hits, Coherence coherence) const;

  // blocked[i] = 1 if anything in the scene occludes ray i, for each i of `indices`; other entries are unchanged.
  void occluded(const RayBatch& rays, std::span<const uint32_t> indices, uint8_t* blocked) const;

  // The same against one instance only (rays in world space).
  void occluded_by(uint32_t instance, const RayBatch& rays, std::span<const uint32_t> indices, uint8_t* blocked) const;

  // Nearest hits of one instance, world space.
  void intersect_with(uint32_t instance, const RayBatch& rays, HitBatch& hits) const;

  // Nearest hits of one shape in object space, for baking: rays.size rays.
  void shape_intersect(uint32_t shape, const RayBatch& rays, ShapeHits& hits) const;
  void shape_occluded(uint32_t shape, const RayBatch& rays, uint8_t* blocked) const;

  // A subset of the scene's instances, made by group(). Must not outlive the Accel.
  class Group;
  std::shared_ptr<const Group> group(std::span<const uint32_t> instances) const;
  // Nearest hits of a group alone, world space.
  void intersect(const Group& group, const RayBatch& rays, HitBatch& hits, Coherence coherence) const;

  size_t memory_bytes() const;  // as Embree reports it

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fieldtrace
