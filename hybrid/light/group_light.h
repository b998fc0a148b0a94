// A group of clusters of shading points under one light: what DirectLight keeps of it from level to level
// (direct_light.h has the levels). Each level first lays out what it asks, and takes the answers when they are there.
//
// Thread-safety: belongs to one thread at a time.
#pragma once

#include <deque>
#include <span>
#include <vector>

#include "core/light/light_irradiance.h"
#include "hybrid/light/light_strata.h"
#include "hybrid/light/reflected_light.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"

namespace fieldtrace {

// Light samples in one batch, which stays in the second-level cache.
inline constexpr int k_shadow_batch = 8192;

// Strata of a light, at the default tolerance: where fields leave more open, they are not trusted about the others
// (docs/decisions/023-clusters.md).
inline constexpr int k_most_undecided_strata = 4;

class GroupLight {
 public:
  // What the groups of a wave of receivers share.
  struct Shared {
    LightReceivers& receivers;
    std::span<const PathVertex> vertices;
    const ShadingClusters& clusters;
    int light_samples = 1;
    int open_samples = 1;       // the same where the light may be hidden
    int64_t pixel_samples = 1;  // as ShadowGroup's
    bool first = false;         // the receivers are those of camera rays
    bool has_sky_maps = false;  // SkyLight lights diffuse clusters
    std::span<FirstHit> firsts;
    Stats& stats;
  };

  explicit GroupLight(const TransportContext& context) : context_(context) {}

  // The group of clusters [begin, end).
  void begin(const Shared& shared, size_t begin, size_t end);
  // Whether the light takes any samples here.
  bool begin_light(uint32_t light);

  // Level by level, with all of the device's or the CPU's answers between what lays out and what takes.
  ShadowAnswerer::CandidateRequest ask_candidates();
  void take_candidates();
  void list_strata();
  bool has_strata() const { return next_filtered_ < filtered_.size(); }
  ShadowAnswerer::FilterRequest ask_strata();  // of the next batch
  void take_strata();                          // of all batches laid out
  void list_open();
  bool has_samples() const { return next_sampled_ < sampled_.size(); }
  ShadowAnswerer::RayRequest ask_samples();  // of the next batch
  void take_samples();                       // of all batches laid out
  // Lights what is seen whole, and ends this light.
  void finish_light();

  Stats& stats() const { return shared_->stats; }

 private:
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

  // Strata of some clusters, or light samples of some receivers, laid out and to be answered.
  struct Batch {
    ShadingPointBatch selected;  // what they were made from
    ShadowBatch shadows;
    std::span<const uint32_t> clusters;
    std::vector<uint8_t> undecided;
    std::span<const Sampled> sampled;
    int samples = 0;          // of each receiver
    bool has_strata = false;  // of some of `sampled` strata are known: rays of the rest are `traced`
    ShadowBatch traced;
    std::vector<uint32_t> traced_slots;  // of `shadows`
  };

  // A batch more, to be taken with the others.
  Batch& next_batch();
  // Irradiance once per cluster, or per shading point where nothing may be estimated.
  void light_clear();
  void add_cluster_irradiance();
  void add_point_irradiance();
  void take_strata(const Batch& batch);
  StrataSeen strata_seen(const Batch& batch, uint32_t cluster, size_t first_slot) const;
  // Draws the light samples of the next of sampled_ that make one batch of about k_shadow_batch.
  Batch& sample_next(bool may_be_hidden);
  std::span<const Sampled> batch_from(size_t begin, int light_samples) const;
  // The same for receivers that nothing hides.
  void sample_clear();
  void choose_traced(Batch& batch);
  // These take the light samples of each point.
  void add_samples(Batch& batch);
  void add_range(const Batch& batch, const Sampled& sampled, size_t first_slot, const LightEstimate& estimate);
  void select(std::span<const Sampled> batch, ShadingPointBatch& selected) const;

  Rgb light_value() const;
  // Whether the whole light lies above a horizon at p, by more than `margin`.
  bool is_above(const Vec3& p, const Vec3& normal, float margin) const;
  // The same for both horizons of all points of a cluster of the group.
  bool is_above(uint32_t cluster) const;
  // Reflects the vector irradiance `irradiance` (of a light of radiance 1) at a cluster's points: of the strata that
  // are decided, or of the whole light, if `seen` is null.
  void add_irradiance(uint32_t cluster, const Vec3& irradiance, const StrataSeen* seen);
  void count_seen(size_t point, float decided, float clear) const;
  FirstHit& first_of(size_t point) const { return shared_->firsts[shared_->receivers.path[point]]; }
  const ShadingCluster& cluster_of(uint32_t cluster) const { return shared_->clusters[begin_ + cluster]; }
  void push_sampled(uint32_t cluster, uint32_t strata = k_none, bool is_lit = false);
  void count_dark();
  // For --check (group_light_checks.cpp): traces what whole lights were found; compares strata, and the irradiance of
  // clusters, with rays.
  void check_whole();
  void check_strata(uint32_t cluster, const StrataSeen& seen) const;
  void check_irradiance(uint32_t cluster, const Vec3& irradiance, const StrataSeen* seen) const;

  const TransportContext& context_;
  const Shared* shared_ = nullptr;
  size_t begin_ = 0, end_ = 0;  // the group's clusters
  uint64_t samples_ = 0;        // of all of them
  uint32_t light_ = 0;
  StrataGrid grid_;             // of the light
  bool counts_open_ = false;    // the light is one for which open_samples is meant
  bool sky_is_mapped_ = false;  // the light is part of a sky that SkyLight gathers
  ShadingPointBatch centres_;   // of the clusters
  ShadowGroup candidates_;
  std::vector<uint32_t> dark_, clear_, open_;  // clusters
  std::vector<uint32_t> filtered_;             // those of open_ whose strata fields may answer
  size_t next_filtered_ = 0, next_sampled_ = 0;
  std::vector<Sampled> sampled_;
  std::vector<StrataSeen> seen_;
  std::vector<uint32_t> seen_of_;  // by cluster: index into seen_, or k_none
  std::deque<Batch> batches_;      // those that are laid out come first
  size_t laid_out_ = 0;
  IrradianceVectors vectors_;
  AlignedVector<float> irradiance_, factors_;
};

}  // namespace fieldtrace
