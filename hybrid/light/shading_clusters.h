// Clusters of shading points: the camera samples of one pixel that met the same instance. What is asked about a light's
// visibility is asked once per cluster.
//
// Memory layout: shading points as structures of arrays in the order of the clusters, each of which is a range of them.
// Thread-safety: values.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/visibility/light_extent.h"

namespace fieldtrace {

struct ShadingCluster {
  uint32_t begin = 0, end = 0;  // range of shading points
  float spread = 0;             // bound on the length of a point's normal (either) less the mean one
  bool plain_diffuse = true;    // all points
  uint32_t size() const { return end - begin; }
};

class ShadingClusters {
 public:
  // Clusters of the vertices that take light samples (neither delta nor dark), of at most `most` points each, in the
  // order of the vertices. Vertices of one pixel must be consecutive. A cluster's radius is at most the share `widest`
  // of its distance from each of `lights`; wider ones fall apart into single points. single: every vertex is its own
  // cluster.
  void build(std::span<const PathVertex> vertices, std::span<const PathState> paths,
             std::span<const LightExtent> lights, float widest, uint32_t most, bool single);

  size_t size() const { return clusters_.size(); }
  const ShadingCluster& operator[](size_t c) const { return clusters_[c]; }

  // All shading points; the vertex of each, and what it reflects: albedo / pi where it is plainly diffuse, else 0.
  ShadingPointBatch points;
  std::vector<uint32_t> vertices;
  AlignedVector<float> red, green, blue;

  // The points that stand for clusters [begin, end): their points' mean position and normals, with the radius about it.
  // Sample indices are 0.
  void centres(size_t begin, size_t end, ShadingPointBatch& out) const;

 private:
  struct Centre {
    Vec3 position, facing, shading;
    float radius = 0, error = 0;
  };
  void fill(std::span<const PathVertex> all, std::span<const PathState> paths);
  void add(std::span<const PathVertex> all, std::span<const LightExtent> lights, float widest, uint32_t begin,
           uint32_t end);
  Centre find_centre(ShadingCluster& cluster) const;

  std::vector<ShadingCluster> clusters_;
  std::vector<Centre> centres_;
};

// out[i] = from[index].
void copy_shading_point(const ShadingPointBatch& from, size_t index, size_t i, ShadingPointBatch& out);

}  // namespace fieldtrace
