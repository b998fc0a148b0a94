// The kernels of gpu/kernels.cu as the CUDA compiler translated them to PTX, run by the CPU (tests/gpu/ptx_to_cpp.py).
//
// Thread-safety: kernels may run at once if what they write is not shared.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace fieldtrace::ptx {

struct PtxKernel {
  int variant;            // architectures whose PTX is the same share one
  std::string targets;    // the architectures
  std::string name;       // of the kernel
  size_t argument_bytes;  // size of its structure
  // For all thread blocks; addresses are the host's. Throws PtxFault for what a GPU would stop at.
  void (*launch)(uint32_t blocks, const void* arguments);
};

// For each variant all kernels; none where there is no CUDA compiler.
const std::vector<PtxKernel>& ptx_kernels();

// Said of tests that are skipped because there are none.
inline constexpr const char* k_no_kernels = "no CUDA compiler, or no Python to translate its PTX";

// The instructions that may not be in a kernel, or are unknown: architecture, kernel, opcode and why.
const std::vector<std::string>& ptx_refusals();

}  // namespace fieldtrace::ptx
