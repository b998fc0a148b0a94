// The segment kernels with one float a lane: the reference, and `--isa scalar`.
#pragma once

#include "field/query/segment_kernels.h"

namespace fieldtrace {

const SegmentKernels& segment_kernels_scalar();

}  // namespace fieldtrace
