// The light of the sky on diffuse surfaces, by direction cells: what is hidden of each cell is read from direction maps,
// once per cluster of shading points. Cells that maps leave undecided are rays.
//
// The irradiance is that of the open sky less what cells take from it. In undecided cells a cluster sends as many of
// its light samples as these cells' share of the light, at least one, stratified over them by weight. Concentrated
// sources (a sun) are a light of their own, sampled like any other.
// Thread-safety: a SkyLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "hybrid/light/light_receivers.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/sky/sky_maps.h"

namespace fieldtrace {

class SkyLight {
 public:
  explicit SkyLight(const TransportContext& context) : context_(context) {}

  // Adds the sky's light to what arrives at the plainly diffuse ones of `clusters`. The other arguments: as
  // DirectLight::gather.
  void gather(const ShadingClusters& clusters, LightReceivers& receivers, int light_samples,
              std::span<FirstHit> firsts, Stats& stats);

 private:
  struct Job {
    const ShadingClusters& clusters;
    LightReceivers& receivers;
    int light_samples;
    std::span<FirstHit> firsts;
    Stats& stats;
  };
  // A cell that is undecided for a point of the batch, and its weight there.
  struct OpenCell {
    uint32_t point, cell;
    float weight;
  };
  // A ray towards an open cell: what it brings if nothing is met.
  struct CellRay {
    uint32_t point;
    Rgb irradiance;
  };

  void gather_batch(const Job& job, std::span<const uint32_t> clusters);
  void find_occluders(const Job& job, uint32_t instance);
  void add_map(const SkyOccluder& occluder);
  void see_cells(const Job& job, uint32_t instance);
  void sort_open_cells();
  void sample_open_cells(const Job& job, std::span<const uint32_t> clusters);
  void trace(const Job& job);
  // The light of the concentrated source at the batch's clusters.
  void add_concentrated(const Job& job, std::span<const uint32_t> clusters);
  void add_concentrated_to(const Job& job, std::span<const uint32_t> clusters, bool may_be_hidden);
  bool may_hide_concentrated(uint32_t point) const;

  const TransportContext& context_;
  ShadingPointBatch centres_;  // of the batch's clusters
  size_t padded_size_ = 0;
  Sphere ball_;                // about the batch's points
  Vec3 mean_normal_ = Vec3(0.0f);
  float normal_sine_ = 0.0f, normal_cosine_ = 1.0f;  // of the angle to the farthest normal
  const SkyCells* cells_ = nullptr;
  Mat3 grid_ = Mat3(1.0f);
  std::vector<uint32_t> lit_;                       // cells that may be above a horizon
  std::vector<std::vector<MapLines>> maps_;         // by place in lit_
  std::vector<std::vector<PlaneLines>> planes_;
  std::vector<std::vector<BallLines>> balls_;
  AlignedVector<float> red_, green_, blue_;  // of the cells' sums, then the irradiance
  AlignedVector<int32_t> undecided_;
  std::vector<OpenCell> open_cells_, sorted_cells_;
  std::vector<uint32_t> open_begin_;
  std::vector<CellRay> cell_rays_;
  RayBatch rays_;
  std::vector<uint32_t> ray_indices_;
  std::vector<uint8_t> blocked_;
  std::vector<const SkyOccluder*> hiding_;  // may hide the concentrated source from some of the batch
  std::vector<uint32_t> open_clusters_, hidden_clusters_;
  ShadingPointBatch selected_;
  ShadowBatch shadows_;
};

}  // namespace fieldtrace
