// Batch loops over segment queries, one table of functions per instruction set.
//
// Thread-safety: the kernels are pure apart from what they write. Memory layout: ray arrays as in core/rays.h; outputs
// are padded and aligned likewise.
#pragma once

#include <cstdint>

#include "core/isa.h"
#include "core/rays.h"
#include "field/view.h"

namespace fieldtrace {

// One candidate object for a batch of rays.
struct SegmentTask {
  FieldView field;
  QueryPolicy policy;
  float to_unit[12];      // world -> unit space of the object, 3 x 4, column-major
  uint32_t instance = 0;  // rays whose receiver lies on this instance are `own`
};

// An object without a field: its bounds decide which rays must be traced.
struct BoxTask {
  float to_object[12];       // world -> object space, 3 x 4, column-major
  float lower[3], upper[3];  // object space
  uint32_t instance = 0;
  bool skip_own = false;  // flat objects cannot block rays that leave them
};

struct SegmentCounts {
  uint64_t crossings = 0;  // rays that meet the bounds
  uint64_t lookups = 0;    // cells read
  uint64_t unknown = 0;    // rays whose verdict is unknown_*
};

struct SegmentKernels {
  // verdict[i] (k_verdict_* of field/query.hd.h) and, where it is unknown_*, slice[i], for i in [begin, end); begin and
  // end are multiples of 16 or the batch's padded size. receiver_instance[i] names the instance that ray i leaves.
  SegmentCounts (*query)(const SegmentTask&, const RayBatch&, const uint32_t* receiver_instance, size_t begin,
                         size_t end, int32_t* verdict, int32_t* slice);
  // verdict[i] = k_verdict_ask where ray i meets the ball, whatever the field says: for exact rendering.
  SegmentCounts (*cross_ball)(const SegmentTask&, const RayBatch&, size_t begin, size_t end, int32_t* verdict);
  // The same for the bounding box of an object without a field.
  SegmentCounts (*cross_box)(const BoxTask&, const RayBatch&, const uint32_t* receiver_instance, size_t begin,
                             size_t end, int32_t* verdict);
};

// The kernels of a resolved instruction set (not Isa::automatic; unchecked).
const SegmentKernels& segment_kernels(Isa isa);

}  // namespace fieldtrace
