// Direct light at a wave of path vertices, in four levels; each settles what it can and leaves the rest to the next.
//
// 1. The vertices of a pixel form clusters (shading_clusters.h). Instances that may stand between a cluster and a light
//    are found once; none: the light is seen whole.
// 2. Fields answer whole lights per cluster: clear, hidden, or open.
// 3. Open clusters: strata of the light, each filtered from coverage maps: a visible share, or undecided.
// 4. Light samples in undecided strata, and those of clusters that no field answers, become shadow rays.
// Monte Carlo has level 1 and 4 alone. Diffuse surfaces reflect what is settled as one irradiance per cluster where the
// whole light is above their horizon; everything else weighs each light sample by itself.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <array>
#include <span>
#include <utility>
#include <vector>

#include "core/light/light_irradiance.h"
#include "hybrid/light/reflected_light.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"

namespace fieldtrace {

// Light samples in one batch, which stays in the second-level cache.
inline constexpr int k_shadow_batch = 8192;

// The strata of a light: a grid of k_strata_side x k_strata_side cells of its sample square.
inline constexpr int k_strata_side = 4;
inline constexpr int k_strata = k_strata_side * k_strata_side;

// One in so many of a cluster's samples in an undecided stratum is traced before the others.
inline constexpr uint32_t k_samples_per_first = 2;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `first`: the vertices are those of camera rays, all samples of a pixel one after another. `firsts`,
  // if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples, bool first,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  // What gather() was given, and the light being gathered.
  struct Job {
    std::span<const PathVertex> vertices;
    std::span<const PathState> paths;
    int light_samples = 1;
    std::span<FirstHit> firsts;
    std::span<Rgb> arriving;
    Stats& stats;
    size_t begin = 0, end = 0;  // the group's clusters
    uint32_t light = 0;
  };
  // A light's visibility from one cluster, by strata. Strata are undecided where share < 0.
  struct StrataSeen {
    float share[k_strata];
    Vec3 irradiance = Vec3(0.0f);  // vector irradiance of the decided strata, for a light of radiance 1
    float decided = 0, clear = 0;  // means over all strata: of those decided, and of what they leave clear
    bool whole = false;            // all strata lie above the cluster's horizon, and the light has a closed form
  };
  // A vertex whose light samples are drawn; those of a cluster follow one another.
  struct Sampled {
    uint32_t vertex = 0, cluster = 0;
    uint32_t strata = k_none;  // index into seen_; k_none: nothing is known
    bool is_lit = false;       // what is decided has been added already
  };

  void gather_group(Job& job);
  void gather_light(const Job& job);
  // Irradiance once per cluster, or per vertex where nothing may be estimated.
  void light_clear(const Job& job);
  void add_cluster_irradiance(const Job& job);
  void add_vertex_irradiance(const Job& job);
  // Fills seen_ for those of open_ whose strata fields may answer, and moves those that these settle.
  void filter_strata(const Job& job);
  void filter_batch(const Job& job, std::span<const uint32_t> clusters);
  StrataSeen strata_seen(const Job& job, uint32_t cluster, size_t first_slot) const;
  void light_open(const Job& job);
  // Draws the light samples of sampled_, has those answered that may be hidden and are not settled, and adds up their
  // light.
  void sample(const Job& job, bool may_be_hidden);
  void answer(const Job& job, std::span<const Sampled> batch);
  // Sorts the slots of a batch whose stratum is undecided into traced_slots_ and waiting_.
  void sort_undecided(const Job& job, std::span<const Sampled> batch, bool on_grid);
  void trace_slots(const Job& job);
  void settle_waiting(const Job& job);
  void add_samples(const Job& job, std::span<const Sampled> batch);
  void select_vertices(const Job& job, std::span<const Sampled> batch);

  bool on_grid(const Job& job) const;  // cells of the light's sample square are parts of the light
  // Whether the whole light lies above a horizon at p, by more than `margin`.
  bool is_above(const Job& job, const Vec3& p, const Vec3& normal, float margin) const;
  bool sees_whole(const Job& job, const PathVertex& v) const;
  // Adds the light of a vertex of irradiance `irradiance` (for a light of radiance 1); `decided` is the share of the
  // light that this accounts for, `clear` what is seen of it.
  void add_irradiance(const Job& job, uint32_t vertex, float irradiance, float decided, float clear) const;
  std::span<const uint32_t> members(const Job& job, uint32_t cluster) const {
    return clusters_.members(clusters_[job.begin + cluster]);
  }
  void count_dark(const Job& job);
  void check(const Job& job);

  const TransportContext& context_;
  ShadingClusters clusters_;
  ShadingPointBatch points_;    // of the group's clusters
  ShadingPointBatch selected_;  // some of them, or single vertices
  ShadowGroup candidates_;
  std::vector<uint32_t> dark_, clear_, open_;  // clusters of the group
  std::vector<Sampled> sampled_;
  std::vector<StrataSeen> seen_;
  std::vector<uint32_t> seen_of_;  // by cluster of the group: index into seen_, or k_none
  IrradianceVectors vectors_;
  AlignedVector<float> irradiance_;
  ShadowBatch shadows_, traced_;
  std::vector<uint8_t> undecided_;
  // Slots of shadows_ to be traced; and those whose stratum has had its first samples, which agreeing neighbours settle.
  std::vector<uint32_t> traced_slots_;
  struct Waiting {
    uint32_t slot = 0, grid = 0, cell = 0;
  };
  std::vector<Waiting> waiting_;
  // Per cluster of the batch, what is known of each stratum: a share, or below 0.
  std::vector<std::array<float, k_strata>> grids_;
  std::vector<std::pair<uint32_t, uint32_t>> first_cells_;  // of traced_slots_: grid and cell
};

}  // namespace fieldtrace
