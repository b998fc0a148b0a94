// Traces exact rays for a subset of a batch.
//
// Thread-safety: that of Accel; a RaySubset belongs to one thread.
#pragma once

#include <cstdint>
#include <span>

#include "core/trace/accel.h"

namespace fieldtrace {

struct RaySubset {
  RayBatch rays;
  HitBatch hits;
};

// hits[i] becomes the nearest hit of rays[i] in the whole scene for each i of `which`; other entries stay as they are.
inline void intersect_subset(const Accel& accel, const RayBatch& rays, std::span<const uint32_t> which, HitBatch& hits,
                             RaySubset& work) {
  if (which.empty()) return;
  work.rays.resize(which.size());
  for (size_t j = 0; j < which.size(); ++j) work.rays.copy(j, rays, which[j]);
  work.hits.resize(which.size());
  accel.intersect(work.rays, work.hits, Coherence::incoherent);
  for (size_t j = 0; j < which.size(); ++j) hits.copy(which[j], work.hits, j);
}

}  // namespace fieldtrace
