// The diffuse radiance that leaves an instance's surface, shaded once per small patch of its triangles, on demand.
//
// Lights and objects stand still during a picture, and a diffuse surface emits the same radiance in all directions, so
// all glossy rays that meet the object can share it. A triangle is cut into n x n patches, n from its longest edge; a
// patch is shaded at its centre, by light samples and by paths that continue from there. Space: world for lengths;
// linear radiance. Thread-safety: any number of threads may shade and read at once; a patch that two threads shade
// comes out the same.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <span>
#include <vector>

#include "hybrid/path/transport_context.h"

namespace fieldtrace {

class SurfaceRadiance {
 public:
  // One side of a patch: 2 patch + 1 is the side that the geometric normal points away from, 2 patch the other.
  using Side = uint32_t;

  // Whether an instance's radiance is the same in all directions: a diffuse, opaque mesh, textured or not, without
  // emission.
  static bool suits(const Scene& scene, uint32_t instance);

  // The number of patches with edges of at most `patch` (world units, > 0) that cover an instance; fewer than
  // k_most_patches may be made.
  static uint64_t count_patches(const Scene& scene, uint32_t instance, float patch);
  static constexpr uint64_t k_most_patches = uint64_t(1) << 31;

  // Patches are the first surfaces of paths of `shading`, which must outlive this. Its max_depth counts from them, its
  // light_samples must be k_patch_samples, and its answerer must trace whole scenes (AnswererSettings::whole_scene), so
  // that a patch's radiance does not depend on which others are shaded with it.
  SurfaceRadiance(const TransportContext& shading, uint32_t instance, float patch);

  uint32_t instance() const { return instance_; }
  uint64_t bytes() const { return radiance_.size() * sizeof(Rgb) + shaded_.size() + first_.size() * sizeof(uint32_t); }

  // u, v: barycentric coordinates of vertices 1 and 2, within rounding of the triangle.
  Side side_at(uint32_t triangle, float u, float v, bool back) const;
  // Shades those of `sides` that are not shaded yet. Returns the number of rays traced for that.
  uint64_t shade(std::span<const Side> sides);
  // The side must have been shaded; unchecked.
  Rgb radiance(Side side) const;

 private:
  struct PatchPlace {
    uint32_t triangle;
    int divisor;   // of the triangle
    size_t place;  // within it
  };
  PatchPlace place_of(Side side) const;
  Rgb mean_reflectance(Side side, bool behind) const;
  HitBatch centres_of(std::span<const Side> sides) const;
  PathVertex vertex_at(Side side, const SurfacePoint& surface, Material& material) const;

  const Scene& scene_;
  uint32_t seed_;
  uint32_t instance_;
  bool is_textured_;
  std::vector<uint32_t> first_;    // per triangle and one more: its first patch
  std::vector<uint16_t> divisor_;  // per triangle: n
  std::vector<Rgb> radiance_;      // per side
  std::vector<uint8_t> shaded_;    // per side: 1 once its radiance is there
  tbb::enumerable_thread_specific<std::unique_ptr<PathFollower>> followers_;
};

}  // namespace fieldtrace
