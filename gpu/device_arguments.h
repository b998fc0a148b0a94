// What the kernels take and give. A thread block is one warp and answers one block of k_batch_padding (32) rays or
// shading points: lane l of warp b has the entry blocks[b] + l of the arrays that a wave's questions share. Answers are
// a structure of masks for each warp (field/query/answer_masks.h). A warp in which any lane met something that is not
// resident answers nothing: its lanes name what they met, in any order, in 4 words each of `missing`.
//
// Thread-safety: values. Memory layout: pointers are device addresses; plain data throughout.
#pragma once

#include <cstdint>

#include "core/light/light.hd.h"
#include "core/platform/platform.h"
#include "field/maps/cell_task.h"
#include "field/query/answer_masks.h"
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

// ShadingPointBatch as light_cones() reads it. Of `transmits` word i is a mask of the points from 32 i on.
struct PointArrays {
  const float *px, *py, *pz, *gx, *gy, *gz, *error, *radius;
  const uint32_t *instance, *transmits;
};

struct RayArrays {
  const float *ox, *oy, *oz, *dx, *dy, *dz, *tmax;
};

// ShadingPointBatch as light_rays() reads it.
struct ReceiverArrays {
  const float *px, *py, *pz, *gx, *gy, *gz, *sx, *sy, *sz, *error, *radius;
  const uint32_t *seed, *sample, *instance, *transmits;
};

// What a warp of light_rays() makes: the rays of slots `first` to first + 31, each slot's shading point being `point` +
// its number / range.count. Others than the first `slots` are inactive.
struct LightRayBlock {
  uint32_t point, first, slots;
};

// The tables of lights whose samples need one.
struct LightTables {
  const int32_t* point_sets;  // make_point_sets(); unused on a grid (range.columns > 0)
  const LightTriangle* triangles;
  const EnvironmentRow* rows;
  const float *sums, *texels;
};

// Makes the rays of core/light/light_sampling.h.
struct LightRayArguments {
  Light light;
  uint32_t light_index;
  LightSampleRange range;
  bool any_transmits;  // of the shading points that sample_light() was given together
  ReceiverArrays receivers;
  LightTables tables;
  const LightRayBlock* blocks;
  const uint32_t* numbers;  // of the slots, by entry, instead of their places; null: they are numbered as they lie
  float *ox, *oy, *oz, *dx, *dy, *dz, *tmax, *pdf, *radius;  // by entry, as `instance`
  uint32_t* instance;
  uint32_t warps;
};

struct ConeArguments {
  ConeTask task;
  float light_centre[3], light_radius;  // world space
  PointArrays points;
  const uint32_t *blocks, *wanted;  // wanted: a mask of the points that are meant
  ConeMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

struct StratumArguments {
  StratumTask task;
  RayArrays rays;
  const float *pdf, *radius;
  const uint32_t *blocks, *wanted;
  float* clear;  // by entry of the blocks: the share that the object leaves clear
  ShareMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

struct QueryArguments {
  SegmentTask task;
  RayArrays rays;
  const uint32_t* instance;
  const uint32_t* blocks;
  RayMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

// LobeBatch.
struct LobeArrays {
  RayArrays rays;
  const float *nx, *ny, *nz, *density, *blur;
  const uint32_t* instance;
};

struct LobeArguments {
  ConeTask task;
  LobeArrays lobes;
  const uint32_t* blocks;
  float *clear, *red, *green, *blue, *distance;  // by entry of the blocks
  ShareMasks* masks;
  uint32_t* missing;
  uint32_t warps;
};

// What a warp of sky_cells() sees: cells of a sky, in order, from 32 points of one instance.
struct SkyBlock {
  uint32_t first_task, cells;
  uint32_t undecided;  // place of its masks
  float grazing;       // CellPoints::grazing
};

// What see_cell() of all cells of a block leaves in sums that were 0: points and sums by entry, 32 for each block.
// undecided: for each block a mask for each cell.
struct SkyArguments {
  const CellTask* tasks;  // with device addresses
  const SkyBlock* blocks;
  CellPoints points;  // but for grazing
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
