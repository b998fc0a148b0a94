#include "field/query/segment_kernels_scalar.h"

#include "field/query/segment_batch-inl.h"

namespace fieldtrace {

const SegmentKernels& segment_kernels_scalar() {
  static constexpr SegmentKernels k_kernels = scalar::make_segment_kernels<float>();
  return k_kernels;
}

}  // namespace fieldtrace
