// In place of the translated kernels where there is no CUDA compiler: their tests are skipped.
#include "tests/gpu/ptx_counts.h"
#include "tests/gpu/ptx_kernels.h"

namespace fieldtrace::ptx {

const std::vector<PtxKernel>& ptx_kernels() {
  static const std::vector<PtxKernel> none;
  return none;
}

const std::vector<std::string>& ptx_refusals() {
  static const std::vector<std::string> none;
  return none;
}

const std::vector<CountingKernel>& counting_kernels() {
  static const std::vector<CountingKernel> none;
  return none;
}

}  // namespace fieldtrace::ptx
