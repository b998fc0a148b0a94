// Selection among the variants of a kernel compiled by a foreach_target.h translation unit, one per Highway target. For
// use under HWY_ONCE.
#pragma once

#include <hwy/highway.h>

#include "core/simd/isa.h"

#if HWY_TARGETS & HWY_AVX3
#define FT_CASE_AVX512(form) \
  case Isa::avx512:          \
    return N_AVX3::form;
#else
#define FT_CASE_AVX512(form)
#endif

#if HWY_TARGETS & HWY_AVX2
#define FT_CASE_AVX2(form) \
  case Isa::avx2:          \
    return N_AVX2::form;
#else
#define FT_CASE_AVX2(form)
#endif

#if HWY_TARGETS & HWY_SSE4
#define FT_CASE_SSE4(form) \
  case Isa::sse4:          \
    return N_SSE4::form;
#elif HWY_TARGETS & HWY_NEON
#define FT_CASE_SSE4(form) \
  case Isa::sse4:          \
    return N_NEON::form;
#else
#define FT_CASE_SSE4(form)
#endif

// Returns `form` in the namespace of a resolved Isa's target, or `otherwise` if it has no target.
#define FT_RETURN_FORM_FOR(isa, form, otherwise) \
  switch (isa) {                                 \
    FT_CASE_AVX512(form)                         \
    FT_CASE_AVX2(form)                           \
    FT_CASE_SSE4(form)                           \
    default:                                     \
      return otherwise;                          \
  }
