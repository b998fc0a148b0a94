// Direct light of what is cut out of a sky (hybrid/sky/sky_radiance.h), a sun: light samples of its own, and rays only
// where something may stand before it. Thread-safety: belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "core/light/light_sampling.h"
#include "hybrid/light/light_receivers.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {

class ConcentratedLight {
 public:
  // `sky` as for SkyLight.
  ConcentratedLight(const TransportContext& context, const Sky* sky) : context_(context), sky_(sky) {}

  // Finds what may hide the light from any of `points`, which are not empty. Before gather() of clusters among these:
  // that asks about no other objects, of which crowds have many.
  void begin(const ShadingPointBatch& points);
  // Adds what arrives at clusters of one instance, whose centres are `centres`; `vertices`: those of the receivers.
  // `firsts`: as DirectLight::gather; each sample counts there as so many rays as SkyRadiance::concentrated_share().
  void gather(std::span<const ShadingCluster> clusters, const ShadingPointBatch& centres,
              std::span<const PathVertex> vertices, int light_samples, LightReceivers& receivers,
              std::span<FirstHit> firsts, Stats& stats);

 private:
  struct Job {
    std::span<const PathVertex> vertices;
    int light_samples;
    LightReceivers& receivers;
    std::span<FirstHit> firsts;
    Stats& stats;
  };
  bool may_hide(const SkyOccluder& occluder, const Sphere& from) const;
  void gather_some(const Job& job, std::span<const ShadingCluster> clusters, bool may_be_hidden);
  void trace(Stats& stats);

  const TransportContext& context_;
  const Sky* sky_;
  std::vector<const SkyOccluder*> near_;    // hiding the light from some of all points
  std::vector<const SkyOccluder*> hiding_;  // from some of the clusters
  std::vector<ShadingCluster> open_, hidden_;
  ShadingPointBatch selected_;
  ShadowBatch shadows_;
  std::vector<uint32_t> active_;
};

}  // namespace fieldtrace
