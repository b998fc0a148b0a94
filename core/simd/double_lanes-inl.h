// Double-precision lane types over Highway vectors: F64, with the operators and functions of double_lanes.hd.h.
//
// Include only after foreach_target.h, once per target. k_count is half that of float vectors: 8 on AVX-512, 4 on AVX2,
// 2 on SSE4 and NEON. Loads and stores are aligned to k_count floats. Thread-safety: values.

#if defined(FIELDTRACE_CORE_SIMD_DOUBLE_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SIMD_DOUBLE_LANES_INL_H_
#undef FIELDTRACE_CORE_SIMD_DOUBLE_LANES_INL_H_
#else
#define FIELDTRACE_CORE_SIMD_DOUBLE_LANES_INL_H_
#endif

#include <hwy/highway.h>

#include "core/simd/double_lanes.hd.h"
#include "core/simd/lanes-inl.h"

FT_LANES_BEGIN

using DD = hn::CappedTag<double, 8>;
using DHalfF = hn::Rebind<float, DD>;
using DHalfI = hn::Rebind<int32_t, DD>;

struct MaskDoubles {
  hn::Mask<DD> m;
};
struct F64 {
  hn::Vec<DD> v;
};

template <>
struct DoubleLanes<F64> {
  static constexpr int k_count = int(hn::MaxLanes(DD()));
};

HWY_INLINE F64 operator+(F64 a, F64 b) { return {a.v + b.v}; }
HWY_INLINE F64 operator-(F64 a, F64 b) { return {a.v - b.v}; }
HWY_INLINE F64 operator*(F64 a, F64 b) { return {a.v * b.v}; }
HWY_INLINE F64 operator/(F64 a, F64 b) { return {a.v / b.v}; }
HWY_INLINE MaskDoubles operator>(F64 a, F64 b) { return {hn::Gt(a.v, b.v)}; }
HWY_INLINE MaskDoubles operator&(MaskDoubles a, MaskDoubles b) { return {hn::And(a.m, b.m)}; }

// The arguments are swapped for the same reason as in lanes-inl.h.
HWY_INLINE F64 max(F64 a, F64 b) { return {hn::Max(b.v, a.v)}; }
HWY_INLINE F64 sqrt(F64 a) { return {hn::Sqrt(a.v)}; }
HWY_INLINE F64 abs(F64 a) { return {hn::Abs(a.v)}; }
HWY_INLINE F64 select(MaskDoubles m, F64 a, F64 b) { return {hn::IfThenElse(m.m, a.v, b.v)}; }

template <>
HWY_INLINE F64 splat_double<F64>(double a) {
  return {hn::Set(DD(), a)};
}
template <>
HWY_INLINE F64 load_floats<F64>(const float* p) {
  return {hn::PromoteTo(DD(), hn::Load(DHalfF(), p))};
}
HWY_INLINE void store_floats(F64 a, float* p) { hn::Store(hn::DemoteTo(DHalfF(), a.v), DHalfF(), p); }
HWY_INLINE void store_next_floats(F64 a, float* p) {
  const auto bits = hn::BitCast(DHalfI(), hn::DemoteTo(DHalfF(), a.v));
  const auto one = hn::IfThenElseZero(hn::Lt(bits, hn::Set(DHalfI(), 0x7f800000)), hn::Set(DHalfI(), 1));
  hn::Store(hn::BitCast(DHalfF(), hn::Add(bits, one)), DHalfF(), p);
}

FT_LANES_END

#endif  // toggled guard
