// The surfaces of a wave of paths that take light samples, in the order of the paths.
//
// Memory layout: structures of arrays. Surfaces that are plainly diffuse, and where the path ends, are described by
// these alone; the others have a PathVertex each. Thread-safety: values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/light/shading_points.h"
#include "core/surface/surfaces.h"
#include "hybrid/path/path_batch.h"

namespace fieldtrace {

// How a surface reflects, as far as the light of skies is concerned.
enum class ReceiverKind : uint8_t {
  other,
  diffuse,        // plainly
  coated,         // a diffuse body under a rough interface
  smooth_coated,  // under a smooth one: light samples find the body alone
};

struct LightReceivers {
  ShadingPointBatch points;               // radii are 0
  AlignedVector<float> red, green, blue;  // albedo / pi where plainly diffuse, else 0
  AlignedVector<ReceiverKind> kind;
  AlignedVector<uint32_t> cluster;  // a number that those share that may form one: of one pixel, or of a block
  AlignedVector<uint32_t> path;     // index of the PathState
  AlignedVector<uint32_t> vertex;   // index of the PathVertex; k_none: none
  // DirectLight's result: the radiance reflected towards the path, path throughput not included.
  AlignedVector<float> arriving_red, arriving_green, arriving_blue;

  size_t size() const { return points.size; }
  // Forgets all and makes room for `most`.
  void clear(size_t most);
  // `vertex`: whose index is `index`, or k_none if it will not be kept. Skips delta and dark materials.
  void add(const PathVertex& vertex, uint32_t index, const PathState& state, uint32_t cluster_number);
  // Adds a point of a surface, with these normals, and returns its index. Leaves all else to the caller.
  size_t add_point(const SurfacePoint& at, const Vec3& facing, const Vec3& shading);
  // Adds what the rays of a run have met on one side of a surface, all of one plainly diffuse material, and returns the
  // index of the first. Leaves points.seed, points.sample and `cluster` to the caller.
  size_t add_run(const RayBatch& rays, const SurfaceBatch& surfaces, const HitRun& run, uint32_t instance,
                 const Material& material);
  // Gives a plainly diffuse receiver its own albedo.
  void reflect(size_t i, const Rgb& albedo) {
    const Rgb reflected = albedo / k_pi;
    red[i] = reflected.x, green[i] = reflected.y, blue[i] = reflected.z;
  }
  // Sorts [begin, end) by instance, keeping the order otherwise.
  void sort_by_instance(size_t begin, size_t end);

 private:
  std::vector<uint64_t> order_;  // by sort_by_instance(): instances, then places
  std::vector<std::byte> moved_;
};

}  // namespace fieldtrace
