// What the kernels take and give. A thread block is one warp and answers one block of k_batch_padding (32) rays or
// shading points: lane l of warp b has the entry 32 b + l of every array. Answers are a structure of masks for each
// warp, bit l of which is lane l's. A warp in which any lane met something that is not resident answers nothing: all
// bits of its mask `not_baked` are set, and its lanes name what they met, in any order, in 4 words each of `missing`.
//
// Thread-safety: values. Memory layout: pointers are device addresses; plain data throughout.
#pragma once

#include <cstdint>

#include "core/light/light.hd.h"
#include "core/platform/platform.h"
#include "field/maps/cell_task.h"
#include "field/query/query_tasks.h"

namespace fieldtrace::gpu {

inline constexpr uint32_t k_warp = 32;
inline constexpr uint32_t k_all_lanes = 0xffffffffu;  // a mask

// Words of `missing` for each warp. What has no room is named when it is met again.
inline constexpr uint32_t k_missing_words = 4 * k_warp;

// A word of `missing`: a number of a slice or a tile, and what it counts in the two bits above; or k_nothing.
enum class MissingKind : uint32_t { visibility, depth, tile };
inline constexpr uint32_t k_missing_shift = 30;
inline constexpr uint32_t k_nothing = 0xffffffffu;
FT_HD constexpr uint32_t missing_word(MissingKind kind, uint32_t number) {
  return uint32_t(kind) << k_missing_shift | number;
}
constexpr MissingKind missing_kind(uint32_t word) { return MissingKind(word >> k_missing_shift); }
constexpr uint32_t missing_number(uint32_t word) { return word & ((1u << k_missing_shift) - 1); }

// ShadingPointBatch as light_cones() reads it.
struct PointArrays {
  const float *px, *py, *pz, *gx, *gy, *gz, *error, *radius;
  const uint32_t *instance, *transmits;
};

struct RayArrays {
  const float *ox, *oy, *oz, *dx, *dy, *dz, *tmax;
};

// ShadingPointBatch as light_rays() reads it, and what a question asks for all rays of a shading point. None transmits.
struct ReceiverArrays {
  const float *px, *py, *pz, *gx, *gy, *gz, *sx, *sy, *sz, *error, *radius;
  const uint32_t *seed, *sample, *instance;
  const int32_t* wanted;
};

// Makes the rays of core/light/light_sampling.h: warp b those of slots blocks[b] and the 31 after it, each slot's
// shading point being its number / range.count. What has no pointer is not written.
struct LightRayArguments {
  Light light;
  uint32_t light_index;
  LightSampleRange range;
  ReceiverArrays receivers;
  uint32_t slots;             // others are inactive
  const int32_t* point_sets;  // make_point_sets(); unused on a grid (range.columns > 0)
  const uint32_t* blocks;
  float *ox, *oy, *oz, *dx, *dy, *dz, *tmax, *pdf, *radius;
  int32_t* wanted;
  uint32_t* instance;
  uint32_t warps;
};

struct ConeMasks {
  uint32_t clear, blocked, by_strata, not_baked;
  uint32_t lookups;  // of the warp
};

struct ConeArguments {
  ConeTask task;
  float light_centre[3], light_radius;  // world space
  PointArrays points;
  const int32_t* flags;
  ConeMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

struct StratumMasks {
  uint32_t refused, not_baked;
  uint32_t lookups;
};

struct StratumArguments {
  StratumTask task;
  RayArrays rays;
  const float *pdf, *radius;
  const int32_t* wanted;
  float* clear;  // the share that the object leaves clear
  StratumMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

struct RayMasks {
  uint32_t crosses, blocked, undecided, not_baked;
  uint32_t lookups;
};

struct QueryArguments {
  SegmentTask task;
  RayArrays rays;
  const uint32_t* instance;
  RayMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

// The cells of a sky, in order, for the points of one instance: what see_cell() of all of them leaves in sums that were
// 0. undecided: for each warp a mask for each cell.
struct SkyArguments {
  const CellTask* tasks;  // with device addresses
  uint32_t cells;
  CellPoints points;  // a multiple of 32
  CellSums sums;      // all six
  uint32_t* undecided;
  uint32_t warps;
};

// A copy of `words` words from the packet to any place of the device's memory. No two of a launch overlap.
struct ScatterRun {
  uint64_t to;  // device address
  uint32_t from, words;
};

// Warp b copies run b.
struct ScatterArguments {
  const ScatterRun* runs;
  const uint32_t* packet;
  uint32_t warps;
};

}  // namespace fieldtrace::gpu
