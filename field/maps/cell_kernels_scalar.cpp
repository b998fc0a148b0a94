#include "field/maps/cell_kernels-inl.h"

namespace fieldtrace {

const CellKernels& cell_kernels_scalar() {
  static constexpr CellKernels k_kernels = scalar::make_cell_kernels<float>();
  return k_kernels;
}

}  // namespace fieldtrace
