// Clusters of shading points: the camera samples of one pixel that met the same instance, or of a block of pixels where
// rays alone answer (TransportContext::clusters_blocks()). What is asked about a light's visibility is asked once per
// cluster.
//
// Memory layout: each cluster is a range of the shading points.
// Thread-safety: values.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "hybrid/culling/light_extent.h"
#include "hybrid/light/light_receivers.h"

namespace fieldtrace {

struct ShadingCluster {
  uint32_t begin = 0, end = 0;                // range of receivers
  float spread = 0;                           // bound on the length of a point's normal (either) less the mean one
  ReceiverKind kind = ReceiverKind::diffuse;  // of all points
  bool plain_diffuse() const { return kind == ReceiverKind::diffuse; }
  // Whether the light of a sky's maps leaves nothing to light samples.
  bool takes_maps_alone() const { return plain_diffuse() || kind == ReceiverKind::smooth_coated; }
  uint32_t size() const { return end - begin; }
  // The root mean square of these lengths.
  float mean_spread() const { return spread / std::sqrt(float(size())); }
};

// A cluster's radius is at most this share of its distance from any light: light arrives at its points nearly as at its
// centre (docs/decisions/023-clusters.md).
inline constexpr float k_widest_cluster = 0.05f;

class ShadingClusters {
 public:
  // Clusters of at most `most` receivers each, in their order. Those of one number (LightReceivers::cluster)
  // must be consecutive; where they lie on several instances they are sorted by these. Clusters too wide for one of
  // `lights` (k_widest_cluster) fall apart into single points. single: every receiver is its own cluster.
  void build(LightReceivers& receivers, std::span<const LightExtent> lights, uint32_t most, bool single);

  size_t size() const { return clusters_.size(); }
  const ShadingCluster& operator[](size_t c) const { return clusters_[c]; }

  // The points that stand for the clusters: their points' mean position and normals, with the radius about it. Sample
  // indices are 0.
  const ShadingPointBatch& centres() const { return centres_; }
  // Those of clusters [begin, end).
  void centres(size_t begin, size_t end, ShadingPointBatch& out) const {
    out.resize(end - begin);
    out.copy(0, centres_, begin, end - begin);
  }

 private:
  void add(const LightReceivers& receivers, std::span<const LightExtent> lights, size_t begin, size_t end);
  void add_single(const LightReceivers& receivers, size_t i);

  // What normals of these means give.
  struct MeanNormals {
    Vec3 facing = Vec3(0.0f), shading = Vec3(0.0f);
    size_t count = 0;
    Vec3 geometric = Vec3(0.0f), shading_direction = Vec3(0.0f);  // unit
    float spread = 0.0f;
  };

  std::vector<ShadingCluster> clusters_;
  ShadingPointBatch centres_;
  MeanNormals before_;  // of the last cluster: on floors and walls all have the same
};

}  // namespace fieldtrace
