#include "core/simd/isa.h"

#include <hwy/targets.h>

#include <algorithm>

#include "core/platform/error.h"

namespace fieldtrace {

const char* isa_name(Isa isa) {
  switch (isa) {
    case Isa::automatic:
      return "auto";
    case Isa::scalar:
      return "scalar";
    case Isa::sse4:
      return "sse4";
    case Isa::avx2:
      return "avx2";
    case Isa::avx512:
      return "avx512";
  }
  return "unknown";
}

namespace {

// Those of the processor that the kernels are compiled for. Asked once: the instruction that tells costs microseconds
// on a virtual machine.
int64_t processor_targets() {
  static const int64_t targets = hwy::SupportedTargets() & HWY_TARGETS;
  return targets;
}

}  // namespace

std::vector<Isa> supported_isas() {
  std::vector<Isa> isas = {Isa::scalar};
  const int64_t targets = processor_targets();
  if (targets & (HWY_SSE4 | HWY_NEON)) isas.push_back(Isa::sse4);
  if (targets & HWY_AVX2) isas.push_back(Isa::avx2);
  if (targets & HWY_AVX3) isas.push_back(Isa::avx512);
  return isas;
}

Isa resolve_isa(Isa isa) {
  static const std::vector<Isa> isas = supported_isas();
  if (isa == Isa::automatic) return isas.back();
  if (std::find(isas.begin(), isas.end(), isa) == isas.end()) {
    throw UsageError(std::string("this processor cannot run --isa ") + isa_name(isa) + "; use --isa auto");
  }
  return isa;
}

}  // namespace fieldtrace
