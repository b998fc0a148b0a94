// Direct light at a wave of path vertices, in four levels; each settles what it can and leaves the rest to the next.
//
// 1. The vertices of a pixel form clusters (shading_clusters.h). Instances that may stand between a cluster and a light
//    are found once; none: the light is seen whole.
// 2. Fields answer whole lights per cluster: clear, hidden, or open.
// 3. Open clusters: strata of the light, each filtered from coverage maps: a visible share, or undecided. Where many
//    are undecided, all are.
// 4. Light samples in undecided strata, and those of clusters that no field answers, become shadow rays.
// Monte Carlo has levels 1 and 4 alone, and closed forms per shading point. Diffuse surfaces reflect what is settled as
// one irradiance per cluster where the whole light is above their horizon; everything else weighs each light sample by
// itself.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "core/light/light_irradiance.h"
#include "hybrid/light/reflected_light.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/light/sky_light.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"

namespace fieldtrace {

// Light samples in one batch, which stays in the second-level cache.
inline constexpr int k_shadow_batch = 8192;

// The strata of a light: a grid of k_strata_side x k_strata_side cells of its sample square.
inline constexpr int k_strata_side = 4;
inline constexpr int k_strata = k_strata_side * k_strata_side;
// TransportSettings::most_undecided at the default tolerance (docs/decisions/023-clusters.md).
inline constexpr int k_most_undecided_strata = 4;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context), sky_(context, context.sky) {}

  // Sorts the receivers as ShadingClusters does, and fills what arrives at them. `first`: they are those of camera
  // rays, all samples of a pixel one after another. `pixels`: by path, if blocks of pixels are whole, else empty.
  // `firsts`, if not empty, is indexed by path and receives the counts of shadow rays.
  void gather(LightReceivers& receivers, std::span<const PathVertex> vertices, int light_samples, bool first,
              std::span<const PixelPosition> pixels, std::span<FirstHit> firsts, Stats& stats);

 private:
  // What gather() was given, and the light being gathered.
  struct Job {
    LightReceivers& receivers;
    std::span<const PathVertex> vertices;
    int light_samples = 1;
    int open_samples = 1;      // the same where the light may be hidden
    bool first = false;        // the receivers are those of camera rays
    bool counts_open = false;  // `light` is one for which open_samples is meant
    std::span<FirstHit> firsts;
    Stats& stats;
    size_t begin = 0, end = 0;  // the group's clusters
    uint32_t light = 0;
    bool has_sky_maps = false;   // SkyLight lights diffuse clusters
    bool sky_is_mapped = false;  // and `light` is part of the sky
  };
  // A light's visibility from one cluster, by strata. Strata are undecided where share < 0.
  struct StrataSeen {
    float share[k_strata];
    Vec3 irradiance = Vec3(0.0f);  // vector irradiance of the decided strata, for a light of radiance 1
    float decided = 0, clear = 0;  // means over all strata: of those decided, and of what they leave clear
    bool whole = false;            // all strata lie above the cluster's horizon, and the light has a closed form
  };
  // Receivers whose light samples are drawn; those of a cluster (of the group) follow one another.
  struct Sampled {
    uint32_t begin = 0, end = 0, cluster = 0;
    uint32_t strata = k_none;  // index into seen_; k_none: nothing is known
    bool is_lit = false;       // what is decided has been added already
    uint32_t size() const { return end - begin; }
  };

  void gather_group(Job& job);
  void gather_light(const Job& job);
  // Irradiance once per cluster, or per shading point where nothing may be estimated.
  void light_clear(const Job& job);
  void add_cluster_irradiance(const Job& job);
  void add_point_irradiance(const Job& job);
  // Fills seen_ for those of open_ whose strata fields may answer, and moves those that these settle.
  void filter_strata(const Job& job);
  void filter_batch(const Job& job, std::span<const uint32_t> clusters);
  StrataSeen strata_seen(const Job& job, uint32_t cluster, size_t first_slot) const;
  void light_open(const Job& job);
  // Draws the light samples of sampled_, has those answered that may be hidden and are not settled, and adds up their
  // light.
  void sample(const Job& job, bool may_be_hidden);
  // Those of sampled_ from `begin` on that make one batch of about k_shadow_batch light samples.
  std::span<const Sampled> batch_from(size_t begin, int light_samples) const;
  // These take the light samples of each point.
  void answer(const Job& job, std::span<const Sampled> batch, int samples);
  void add_samples(const Job& job, std::span<const Sampled> batch, int samples);
  void add_range(const Job& job, const Sampled& sampled, size_t first_slot, int samples, const LightEstimate& estimate);
  void select(const Job& job, std::span<const Sampled> batch);

  bool on_grid(const Job& job) const;  // cells of the light's sample square are parts of the light
  // Whether the whole light lies above a horizon at p, by more than `margin`.
  bool is_above(const Job& job, const Vec3& p, const Vec3& normal, float margin) const;
  // The same for both horizons of all points of a cluster of the group.
  bool is_above(const Job& job, uint32_t cluster) const;
  // Reflects the vector irradiance `irradiance` (of a light of radiance 1) at a cluster's points; `decided` is the
  // share of the light that this accounts for, `clear` what is seen of it.
  void add_irradiance(const Job& job, uint32_t cluster, const Vec3& irradiance, float decided, float clear);
  void count_seen(const Job& job, size_t point, float decided, float clear) const;
  FirstHit& first_of(const Job& job, size_t point) const { return job.firsts[job.receivers.path[point]]; }
  const ShadingCluster& cluster_of(const Job& job, uint32_t cluster) const { return clusters_[job.begin + cluster]; }
  void push_sampled(const Job& job, uint32_t cluster, uint32_t strata = k_none, bool is_lit = false);
  void count_dark(const Job& job);
  // For --check: traces what whole lights were found; and compares strata with rays.
  void check_whole(const Job& job);
  void check_strata(const Job& job, uint32_t cluster, const StrataSeen& seen) const;

  const TransportContext& context_;
  SkyLight sky_;
  ShadingClusters clusters_;
  ShadingPointBatch centres_;   // of the group's clusters
  ShadingPointBatch selected_;  // some of them, or receivers
  ShadowGroup candidates_;
  std::vector<uint32_t> dark_, clear_, open_;  // clusters of the group
  std::vector<Sampled> sampled_;
  std::vector<StrataSeen> seen_;
  std::vector<uint32_t> seen_of_;  // by cluster of the group: index into seen_, or k_none
  IrradianceVectors vectors_;
  AlignedVector<float> irradiance_, factors_;
  ShadowBatch shadows_, traced_;
  std::vector<uint8_t> undecided_;
  std::vector<uint32_t> traced_slots_;  // of shadows_
};

}  // namespace fieldtrace
