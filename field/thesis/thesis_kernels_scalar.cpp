#include "field/thesis/thesis_batch-inl.h"

namespace fieldtrace {

const ThesisKernels& thesis_kernels_scalar() {
  static constexpr ThesisKernels k_kernels = scalar::make_thesis_kernels<float>();
  return k_kernels;
}

}  // namespace fieldtrace
