// Clusters of shading points: the camera samples of one pixel that met the same instance. What is asked about a light's
// visibility is asked once per cluster.
//
// Memory layout: a cluster is a range of `members`, which index the vertices. Thread-safety: values.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/visibility/light_extent.h"

namespace fieldtrace {

struct ShadingCluster {
  uint32_t begin = 0, end = 0;  // of members
  uint32_t size() const { return end - begin; }
};

// A cluster's radius is at most this share of its distance from any light: the rays from its points to a light are then
// nearly those from its centre. Wider ones fall apart into single points.
inline constexpr float k_widest_cluster = 0.05f;

class ShadingClusters {
 public:
  // Clusters of the vertices that take light samples (neither delta nor dark), of at most `most` points each, in the
  // order of the vertices. Vertices of one pixel must be consecutive, and `lights` are those that must be far away.
  // single: every vertex is its own cluster.
  void build(std::span<const PathVertex> vertices, std::span<const LightExtent> lights, uint32_t most, bool single);

  size_t size() const { return clusters_.size(); }
  const ShadingCluster& operator[](size_t c) const { return clusters_[c]; }
  std::span<const uint32_t> members(const ShadingCluster& c) const {
    return std::span(members_).subspan(c.begin, c.size());
  }
  // The points that stand for clusters [begin, end): their members' mean position and normals, with the radius about
  // it. Sample indices are 0.
  void points(std::span<const PathVertex> vertices, size_t begin, size_t end, ShadingPointBatch& out) const;

 private:
  struct Centre {
    Vec3 position, facing, shading;
    float radius = 0, error = 0;
  };
  void add(std::span<const PathVertex> vertices, std::span<const LightExtent> lights, uint32_t begin, uint32_t end);
  static Centre centre_of(std::span<const PathVertex> vertices, std::span<const uint32_t> members);

  std::vector<uint32_t> members_;
  std::vector<ShadingCluster> clusters_;
  std::vector<Centre> centres_;
};

// Writes one vertex as entry i of a batch: a single point.
void set_shading_point(const PathVertex& vertex, uint32_t sample, size_t i, ShadingPointBatch& out);

}  // namespace fieldtrace
