#include "core/simd/isa.h"

#include <hwy/detect_targets.h>

#if HWY_ARCH_X86_64
#include <cpuid.h>
#endif

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

#if HWY_ARCH_X86_64
// Unlike others, not every compiler's __builtin_cpu_supports() knows it.
bool has_f16c() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(1, &a, &b, &c, &d) != 0 && (c & bit_F16C) != 0;
}
#endif

// Those of the processor that the kernels are compiled for, by the features that Highway compiles them with
// (HWY_TARGET_STR_SSE4 and so on). Highway's library tells them too, but measures a clock when a program starts, which
// takes 6 ms.
int64_t processor_targets() {
  int64_t targets = HWY_BASELINE_TARGETS;
#if HWY_ARCH_X86_64
  const bool has_sse4 = __builtin_cpu_supports("ssse3") && __builtin_cpu_supports("sse4.1") &&
                        __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("aes") &&
                        __builtin_cpu_supports("pclmul");
  const bool has_avx2 = has_sse4 && __builtin_cpu_supports("avx") && __builtin_cpu_supports("avx2") &&
                        __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                        __builtin_cpu_supports("bmi2") && has_f16c();
  const bool has_avx3 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (has_sse4) targets |= HWY_SSE4;
  if (has_avx2) targets |= HWY_AVX2;
  if (has_avx3) targets |= HWY_AVX3;
#endif
  return targets & HWY_TARGETS;
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
