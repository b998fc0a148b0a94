// Batch loops over segment queries, one table of functions per instruction set.
//
// A batch of rays is tested against one candidate object after another; their answers are combined per ray in
// RayStates. Ranges [begin, end) are multiples of k_batch_padding rays. Thread-safety: the kernels are pure apart from
// what they write. Memory layout: ray arrays as in core/trace/rays.h; states are padded and aligned likewise.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "core/simd/isa.h"
#include "core/trace/rays.h"
#include "field/query/hit_batch.h"
#include "field/query/query_tasks.h"

namespace fieldtrace {

// The candidates' answers about each ray so far.
struct RayStates : RayStateBits {
  AlignedVector<int32_t> state;
  AlignedVector<int32_t> undecided_slot;  // candidate_slot of the last undecided candidate
  // Blocks of k_batch_padding rays that met cells not baked yet, by their first ray, with their states untouched; and
  // the slices to bake.
  std::vector<uint32_t> unknown_blocks, unknown_visibility, unknown_depth;
  // Verdict per ray (k_verdict_* of field/query/query.hd.h) of the last candidate; filled if `keep_verdicts`.
  AlignedVector<int32_t> verdict;
  bool keep_verdicts = false;

  void reset(size_t rays) {
    state.assign(padded(rays), 0);
    undecided_slot.resize(padded(rays));
    if (keep_verdicts) verdict.resize(padded(rays));
  }
};

struct SegmentCounts {
  uint64_t crossings = 0;  // rays that meet the bounds
  uint64_t lookups = 0;    // cells read
};

// What light_cones() and filter_strata() met that is not baked: blocks of k_batch_padding shading points or rays, by
// their first index, and what to bake.
struct ConeUnknowns {
  std::vector<uint32_t> blocks, tiles, slices;
  std::array<std::vector<uint32_t>*, 2> lists() { return {&tiles, &slices}; }
};

struct ConeCounts {
  uint64_t clear = 0, blocked = 0;  // shading points answered
  uint64_t lookups = 0;
};

// Samples of reflected lobes, and what filter_lobes() finds of one object along each (field/query/lobe.hd.h). Rays are
// unit and infinite; all arrays are padded like RayBatch.
struct LobeBatch {
  RayBatch rays;
  AlignedVector<float> nx, ny, nz;  // geometric normal of the surface that the ray leaves, on the ray's side
  AlignedVector<float> density;     // samples x density per solid angle: a sample stands for 1 / density
  AlignedVector<float> blur;        // largest tangent that half a texel may subtend
  AlignedVector<uint32_t> instance;

  void resize(size_t n) {
    rays.resize(n);
    for (auto* v : {&nx, &ny, &nz, &density, &blur}) v->resize(padded(n));
    instance.resize(padded(n));
  }
};

struct LobeAnswers {
  AlignedVector<float> clear, red, green, blue, distance;  // distance: t along the ray
  AlignedVector<int32_t> refused;

  void resize(size_t n) {
    for (auto* v : {&clear, &red, &green, &blue, &distance}) v->resize(padded(n));
    refused.resize(padded(n));
  }
};

// The rays left to trace after all candidates, by index.
struct ExactLists {
  AlignedVector<int32_t> one_undecided_slot, many_undecided_slots;
  size_t one_count = 0, many_count = 0;
  uint64_t crossing = 0;  // rays that met at least one candidate's bounds
};

struct SegmentKernels {
  // Adds the answers of `task`'s field about rays [begin, end).
  SegmentCounts (*query)(const SegmentTask&, const RayBatch&, const uint32_t* shading_point_instance, size_t begin,
                         size_t end, int32_t candidate_slot, RayStates&);
  // Every ray that meets the ball is undecided, whatever the field holds: for exact rendering.
  SegmentCounts (*cross_ball)(const SegmentTask&, const RayBatch&, size_t begin, size_t end, int32_t candidate_slot,
                              RayStates&);
  // The same for the bounding box of an object without a field.
  SegmentCounts (*cross_box)(const BoxTask&, const RayBatch&, const uint32_t* shading_point_instance, size_t begin,
                             size_t end, int32_t candidate_slot, RayStates&);
  // flags[r] |= k_may_shadow where the hull of shading point r and a sphere about the light meets the object's ball or
  // box. Conservative.
  void (*hull_meets_ball)(const SegmentTask&, const ShadingPointBatch&, const Sphere& light, int32_t* flags);
  void (*hull_meets_box)(const BoxTask&, const ShadingPointBatch&, const Sphere& light, int32_t* flags);
  // For shading points in `blocks` whose flag is k_may_shadow: the flag becomes 0 where the object leaves the whole
  // ball `light` clear, and k_light_blocked where it hides all of it. Where neither is certain and strata can be tried,
  // k_by_strata is added.
  ConeCounts (*light_cones)(const ConeTask&, const ShadingPointBatch&, const Sphere& light,
                            std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns&);
  // For rays in `blocks` with wanted[i] != 0 and tmax >= 0, each the centre of a stratum of density pdf[i] (1/sr)
  // seen from points within radius[i] (world units) of the ray's origin:
  // multiplies clear[i] by the share of the stratum that the object leaves clear, and sets refused[i] to 1 where the
  // maps do not resolve it. Returns the number of look-ups.
  uint64_t (*filter_strata)(const StratumTask&, const RayBatch&, const float* pdf, const float* radius,
                            const int32_t* wanted, std::span<const uint32_t> blocks, float* clear, int32_t* refused,
                            ConeUnknowns&);
  // met[i] = 1 where a lobe sample (ray unit and infinite; density > 0, per solid angle; both padded) may meet the
  // object; other elements stay as they are.
  void (*lobes_meet)(const ConeTask&, const RayBatch&, const float* density, int32_t* met);
  // For samples in `blocks`: the radiance that the object of `task` sends along each. Of its field, only directions and
  // coverage with radiance are read. Returns the number of look-ups.
  uint64_t (*filter_lobes)(const ConeTask&, const LobeBatch&, std::span<const uint32_t> blocks, LobeAnswers&,
                           ConeUnknowns&);
  // For queries in `blocks`: the object's nearest surface. Blocks added to the unknowns have no answers yet: their
  // lanes' verdicts may also be unknown_*. Returns the number of look-ups.
  uint64_t (*nearest_hits)(const SegmentTask&, const HitQueries&, std::span<const uint32_t> blocks, HitAnswers&,
                           HitUnknowns&);
  // Sets blocked[i] for all rays, and lists the rays that are undecided for some candidate and blocked by none.
  void (*collect)(const RayStates&, size_t rays, uint8_t* blocked, ExactLists&);
};

// The kernels of a resolved instruction set (not Isa::automatic; unchecked).
const SegmentKernels& segment_kernels(Isa isa);

}  // namespace fieldtrace
