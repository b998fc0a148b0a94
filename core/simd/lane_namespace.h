// The namespace of lane code: fieldtrace::scalar in ordinary and GPU translation units, and one per instruction set
// (fieldtrace::N_AVX3, ...) inside a Highway foreach_target translation unit.
#pragma once

#if defined(HWY_TARGET_INCLUDE)
#include <hwy/highway.h>
#define FT_LANES_BEGIN    \
  HWY_BEFORE_NAMESPACE(); \
  namespace fieldtrace {  \
  namespace HWY_NAMESPACE {
#define FT_LANES_END \
  }                  \
  }                  \
  HWY_AFTER_NAMESPACE();
#else
#define FT_LANES_BEGIN   \
  namespace fieldtrace { \
  namespace scalar {
#define FT_LANES_END \
  }                  \
  }
#endif
