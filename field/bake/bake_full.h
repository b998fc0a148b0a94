// Baking a whole field ahead of rendering: every slice that a shadow ray can reach, and every coverage tile.
//
// Only lines that point up reach a visibility cell (a line and its reverse share one), and feet and depths lie within
// the unit ball: the rest of the octahedral square, and the corners of the plane, are never read. Thread-safety:
// bake_full may run beside other bakers of the same field; the others are pure functions.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "field/bake/bake.h"
#include "field/store/field.h"

namespace fieldtrace {

// Whether any query can read the slice.
bool slice_reachable(const FieldParameters& parameters, FieldLayer layer, const SliceAddress& slice);

// Cells in all reachable slices of a layer.
uint64_t reachable_cells(const FieldParameters& parameters, FieldLayer layer);

// Bytes that the bricks of all reachable slices take, with their tables.
uint64_t full_brick_bytes(const FieldParameters& parameters);

struct FullBakeResult {
  bool stopped = false;         // by the callbacks' `stop`
  uint64_t tiles_left_out = 0;  // for lack of room in the field's budget or pool
};

struct FullBakeCallbacks {
  std::function<void(double share)> progress;  // called from one thread at a time, share in [0, 1]
  const std::atomic<bool>* stop = nullptr;     // set to end early: finished slices are kept
};

// Bakes every reachable slice of both layers, then the coverage tiles in the order of their slots, as many as the
// field's budget has room for, on the threads of the current TBB arena. Throws Error, before it starts, if the slices
// do not fit.
FullBakeResult bake_full(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters,
                         const FullBakeCallbacks& callbacks = {});

}  // namespace fieldtrace
