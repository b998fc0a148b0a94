// Look-ups of whole lights and of strata.
#include <cmath>

#include "field/bake/bake.h"
#include "field/bake/bake_coverage.h"
#include "field/query/cone.hd.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

// Spacing of the directions tried over a light as seen from shading points on the object, in mean widths of a direction
// cell. A cell speaks for lines all over it, so closer directions find nothing more (docs/decisions/009-cones.md).
constexpr float k_plane_fit_spacing = 1.1f;
// More than the square root of any number of light samples: for lights too near or too wide.
constexpr int k_no_plane_fit_side = 1 << 12;

int plane_fit_side_for(const ConeTask& task, const Sphere& light) {
  const float cells = cells_across(task, light, LightWidth::largest);
  if (cells == k_infinity) return k_no_plane_fit_side;
  return std::max(1, int(std::ceil(cells / k_plane_fit_spacing)));
}

}  // namespace

template <class Query>
void ShadowAnswerer::bake_and_repeat(const ShadowInstance& o, size_t size, ConeUnknowns& unknowns, Stats& stats,
                                     int most_rounds, const Query& query) const {
  const uint32_t shape = scene_.instances[o.cone.segment.instance].shape;
  const auto bake = [&] {
    // In a full pool this is the last round; single rays answer what is still unknown.
    const bool is_full = o.field->pool_full() || o.field->coverage().full();
    BakeCounters counters;
    if (!unknowns.tiles.empty()) bake_coverage(*o.field, unknowns.tiles, accel_, shape, counters);
    if (!unknowns.slices.empty()) bake_slices(*o.field, FieldLayer::depth, unknowns.slices, accel_, shape, counters);
    stats.add_bake(counters);
    return !is_full;
  };
  query_and_bake(size, unknowns, query, bake, most_rounds);
}

void ShadowAnswerer::query_cones(const ShadowInstance& o, const ShadingPointBatch& shading_points,
                                 const ShadowGroup& group, Workspace& work, Stats& stats) const {
  ConeTask task = o.cone;
  const Sphere& light = group.light.ball;
  const int side = plane_fit_side_for(task, light);
  if (task.segment.reads_depth && side * side <= group.light_samples) task.plane_fit_side = side;
  ConeUnknowns& unknowns = work.unknowns;
  const int most_rounds = std::max(k_most_bake_rounds, 2 * task.plane_fit_side * task.plane_fit_side);
  bake_and_repeat(o, shading_points.size, unknowns, stats, most_rounds, [&](std::span<const uint32_t> blocks) {
    const ConeCounts counts = kernels_.light_cones(task, shading_points, light, blocks, work.flags.data(), unknowns);
    stats.cones_clear += counts.clear;
    stats.cones_blocked += counts.blocked;
    stats.lookups += counts.lookups;
    if (settings_.count_uses) {
      use_of(o, stats).answered += (counts.clear + counts.blocked) * uint64_t(group.light_samples);
    }
  });
}

// Shares of occluders that lie within or through one another are not independent: one may hide what the other hides, or
// what it leaves clear. Sets overlaps_[slot] to the slots of earlier candidates that may overlap slot's; whether any
// may.
bool ShadowAnswerer::find_overlaps(const ShadowGroup& group, Workspace& work) const {
  work.overlaps.assign(group.candidates.size(), 0);
  bool found = false;
  for (size_t slot = 1; slot < group.candidates.size(); ++slot) {
    const ShadowInstance& o = instances_[group.candidates[slot]];
    for (size_t other = 0; o.answers_cones && other < slot; ++other) {
      const ShadowInstance& before = instances_[group.candidates[other]];
      if (!before.answers_cones || !may_overlap(o, before)) continue;
      work.overlaps[slot] |= 1u << other;
      found = true;
    }
  }
  return found;
}

// Multiplies the shares that the candidate in `slot` leaves clear by those of the candidates before it.
void ShadowAnswerer::multiply_shares(size_t slot, Workspace& work, AlignedVector<float>& clear) {
  for (size_t i = 0; i < clear.size(); ++i) {
    const float share = work.clear[i];
    if (share != 1.0f && share != 0.0f) {
      work.dependent[i] |= work.in_part[i] & work.overlaps[slot];
      work.in_part[i] |= 1u << slot;
    }
    clear[i] *= share;
  }
}

void ShadowAnswerer::filter(const ShadowGroup& group, std::span<const uint32_t> shading_points, int strata,
                            ShadowBatch& batch, std::vector<uint8_t>& refused, Stats& stats) const {
  Workspace& work = *workspaces_.local();
  batch.in_shares = true;
  batch.clear.assign(padded(batch.rays.size), 1.0f);
  work.refused.assign(padded(batch.rays.size), 0);
  work.refused_by_thin.assign(padded(batch.rays.size), 0);
  const bool apart = !find_overlaps(group, work);
  if (!apart) {
    work.in_part.assign(padded(batch.rays.size), 0);
    work.dependent.assign(padded(batch.rays.size), 0);
  }
  ConeUnknowns& unknowns = work.unknowns;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const ShadowInstance& o = instances_[group.candidates[slot]];
    if (!o.answers_cones) continue;
    work.flags.assign(padded(batch.rays.size), 0);
    bool is_queried = false;
    for (size_t r = 0; r < shading_points.size(); ++r) {
      if (!(group.by_strata[shading_points[r]] >> slot & 1)) continue;
      is_queried = true;
      std::fill_n(work.flags.begin() + std::ptrdiff_t(r * size_t(strata)), strata, 1);
    }
    if (!is_queried) continue;
    StratumTask task;
    task.segment = o.cone.segment;
    task.least_disc = k_least_light_disc / std::sqrt(float(std::max(strata, k_fewest_strata)));
    task.share = 1.0f / float(std::max(strata, k_fewest_strata));
    if (!apart) work.clear.assign(padded(batch.rays.size), 1.0f);
    AlignedVector<int32_t>& refused_by = task.segment.keeps_angles ? work.refused : work.refused_by_thin;
    float* clear = apart ? batch.clear.data() : work.clear.data();
    bake_and_repeat(o, batch.rays.size, unknowns, stats, k_most_bake_rounds, [&](std::span<const uint32_t> blocks) {
      stats.lookups += kernels_.filter_strata(task, batch.rays, batch.pdf.data(), work.flags.data(), blocks, clear,
                                              refused_by.data(), unknowns);
    });
    if (!apart) multiply_shares(slot, work, batch.clear);
    // Refuse what no pool has room for: rays answer it.
    for (const uint32_t block : unknowns.blocks) std::fill_n(refused_by.begin() + block, k_batch_padding, 1);
  }
  for (size_t i = 0; !apart && i < batch.rays.size; ++i) work.refused[i] |= work.dependent[i] && batch.clear[i] > 0.0f;
  refused.assign(shading_points.size(), 0);
  for (size_t r = 0; r < shading_points.size(); ++r) {
    const auto is_in = [&](const AlignedVector<int32_t>& list) {
      const auto begin = list.begin() + std::ptrdiff_t(r * size_t(strata));
      return std::find(begin, begin + strata, 1) != begin + strata;
    };
    refused[r] = is_in(work.refused_by_thin) ? k_refused_by_thin : is_in(work.refused) ? k_refused : 0;
  }
}

}  // namespace fieldtrace
