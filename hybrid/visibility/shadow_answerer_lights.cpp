// Look-ups of whole lights and of strata.
#include <algorithm>
#include <cmath>
#include <utility>

#include "field/bake/bake.h"
#include "field/bake/bake_coverage.h"
#include "field/query/cone.hd.h"
#include "hybrid/visibility/device_answers.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

// Spacing of the directions tried over a light as seen from shading points on the object, in mean widths of a direction
// cell. A cell speaks for lines all over it, so closer directions find nothing more (docs/decisions/009-cones.md).
constexpr float k_plane_fit_spacing = 1.1f;
// More than the square root of any number of light samples: for lights too near or too wide.
constexpr int k_no_plane_fit_side = 1 << 12;

int plane_fit_side_for(const SegmentTask& segment, const Sphere& light) {
  const float cells = cells_across(segment, light);
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
    sort_unique(unknowns.tiles), sort_unique(unknowns.slices);
    if (!unknowns.tiles.empty()) bake_coverage(*o.field, unknowns.tiles, accel_, shape, counters);
    if (!unknowns.slices.empty()) bake_slices(*o.field, FieldLayer::depth, unknowns.slices, accel_, shape, counters);
    stats.add_bake(counters);
    return !is_full;
  };
  query_and_bake(size, unknowns, query, bake, most_rounds);
}

ConeTask ShadowAnswerer::cone_task(const ShadowInstance& o, const ShadowGroup& group) {
  ConeTask task = o.cone;
  const int side = plane_fit_side_for(task.segment, group.light.ball);
  if (task.segment.reads_depth && side * side <= group.pixel_samples) task.plane_fit_side = side;
  return task;
}

void ShadowAnswerer::query_cones(const ShadowInstance& o, const ConeTask& task, const ConeQuestion* question,
                                 const CandidateRequest& request, Workspace& work) const {
  ConeUnknowns& unknowns = work.unknowns;
  Stats& stats = request.stats;
  const int most_rounds = std::max(k_most_bake_rounds, 2 * task.plane_fit_side * task.plane_fit_side);
  bake_and_repeat(o, request.points.size, unknowns, stats, most_rounds, [&](std::span<const uint32_t> blocks) {
    const ConeCounts counts = light_cones(kernels_, std::exchange(question, nullptr), task, request.points,
                                          request.group.light.ball, blocks, work.flags.data(), unknowns);
    stats.cones_clear += counts.clear;
    stats.cones_blocked += counts.blocked;
    stats.lookups += counts.lookups;
  });
}

// Multiplies the shares that the candidate in `slot` leaves clear by those of the candidates before it. Shares of
// occluders that lie within or through one another are not independent: one may hide what the other hides, or what it
// leaves clear. Strata that two of those hide in part are undecided, and so are those that more than two hide in part.
void ShadowAnswerer::multiply_shares(const ShadowGroup& group, uint32_t slot, Workspace& work,
                                     AlignedVector<float>& clear) const {
  const ShadowInstance& o = instances_[group.candidates[slot]];
  for (size_t i = 0; i < clear.size(); ++i) {
    const float share = work.clear[i];
    clear[i] *= share;
    if (share == 1.0f || share == 0.0f) continue;
    if (work.partial[i][0] == k_none) {
      work.partial[i][0] = slot;
      continue;
    }
    const bool is_third = work.partial[i][1] != k_none;
    work.partial[i][1] = slot;
    if (is_third || may_overlap(o, instances_[group.candidates[work.partial[i][0]]])) work.dependent[i] = 1;
  }
}

StratumTask ShadowAnswerer::stratum_task(const ShadowInstance& o, int strata) {
  StratumTask task;
  task.segment = o.cone.segment;
  task.least_disc = k_least_light_disc / std::sqrt(float(strata));
  task.share = 1.0f / float(strata);
  return task;
}

void ShadowAnswerer::filter(const FilterRequest& request) const {
  const auto& [group, all, shading_points, strata, batch, undecided, stats, questions] = request;
  Workspace& work = workspace();
  const size_t slots = padded(batch.rays.size), count = size_t(strata);
  batch.clear.assign(slots, 1.0f);
  undecided.assign(batch.rays.size, 0);
  work.dependent.assign(slots, 0);
  work.partial.assign(slots, {k_none, k_none});
  work.radius.assign(slots, 0.0f);
  work.place.assign(all.size, k_none);
  for (uint32_t r = 0; r < shading_points.size(); ++r) {
    work.place[shading_points[r]] = r;
    std::fill_n(work.radius.begin() + std::ptrdiff_t(r * count), count, all.radius[shading_points[r]]);
  }
  ConeUnknowns& unknowns = work.unknowns;
  for (size_t n = 0; n < group.open.size(); ++n) {
    const ShadowGroup::OpenCandidate& open = group.open[n];
    const ShadowInstance& o = instances_[group.candidates[open.slot]];
    work.flags.assign(slots, 0);
    bool is_queried = false;
    for (uint32_t i = open.begin; i < open.end; ++i) {
      const uint32_t r = work.place[group.open_points[i]];
      if (r == k_none) continue;
      is_queried = true;
      std::fill_n(work.flags.begin() + std::ptrdiff_t(r * count), count, 1);
    }
    if (!is_queried) continue;
    const StratumTask task = stratum_task(o, strata);
    const StratumQuestion* question = questions.empty() ? nullptr : &questions[n];
    work.clear.assign(slots, 1.0f);
    work.refused.assign(slots, 0);
    bake_and_repeat(o, batch.rays.size, unknowns, stats, k_most_bake_rounds,
                    [&, &stats = stats, &batch = batch](std::span<const uint32_t> blocks) {
                      stats.lookups +=
                          filter_strata(kernels_, std::exchange(question, nullptr), task, batch, work.radius.data(),
                                        work.flags.data(), blocks, work.clear.data(), work.refused.data(), unknowns);
                    });
    // What no pool has room for is undecided.
    for (const uint32_t block : unknowns.blocks) std::fill_n(work.refused.begin() + block, k_batch_padding, 1);
    for (size_t i = 0; i < batch.rays.size; ++i) undecided[i] |= work.flags[i] && work.refused[i];
    multiply_shares(group, open.slot, work, batch.clear);
  }
  for (size_t i = 0; i < batch.rays.size; ++i) {
    undecided[i] |= work.dependent[i] && batch.clear[i] > 0.0f;
  }
}

}  // namespace fieldtrace
