// Embree's occlusion query in each of its packet forms over one mesh, to find the fastest as the baseline.
//
// Separate from core/trace/accel.h, which offers only the form that the renderer uses: here the mesh is a scene without
// instances and transforms, the most favourable case for Embree. Thread-safety: count_blocked() is const.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/trace/rays.h"

namespace fieldtrace {

enum class OcclusionPackets { single, eight_incoherent, sixteen_coherent, sixteen_incoherent };
const char* packets_name(OcclusionPackets packets);

class EmbreeOcclusion {
 public:
  // Throws Error if Embree cannot build.
  explicit EmbreeOcclusion(const TriangleMesh& mesh);
  ~EmbreeOcclusion();

  // Number of rays that hit the mesh. Rays are in the mesh's space; all forms agree except on rays that graze an edge.
  size_t count_blocked(const RayBatch& rays, OcclusionPackets packets) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fieldtrace
