// Double-precision lane types, for what single precision cannot resolve: error bounds and points on surfaces.
//
// As core/simd/lanes.hd.h: generic code is a template over a lane type D and uses only the operators + - * / < > & and
// the functions below, which are correctly rounded or exact. They are defined here for plain `double`, and in
// core/simd/double_lanes-inl.h for Highway vectors with half as many lanes as vectors of floats.
// Thread-safety: pure functions.

#if defined(FIELDTRACE_CORE_SIMD_DOUBLE_LANES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SIMD_DOUBLE_LANES_HD_H_
#undef FIELDTRACE_CORE_SIMD_DOUBLE_LANES_HD_H_
#else
#define FIELDTRACE_CORE_SIMD_DOUBLE_LANES_HD_H_
#endif

#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

template <class D>
struct DoubleLanes;
template <>
struct DoubleLanes<double> {
  static constexpr int k_count = 1;
};

FT_HD inline double max(double a, double b) { return a < b ? b : a; }
FT_HD inline double sqrt(double a) { return ::sqrt(a); }
FT_HD inline double abs(double a) { return ::fabs(a); }
FT_HD inline double select(bool m, double a, double b) { return m ? a : b; }

template <class D>
FT_HD inline D splat_double(double a) {
  return D(a);
}
// Loads one float per lane from consecutive addresses.
template <class D>
FT_HD inline D load_floats(const float* p) {
  return D(*p);
}
// Rounds to floats and stores them at consecutive addresses.
FT_HD inline void store_floats(double a, float* p) { *p = float(a); }
// The same with the float after the rounded one, which is above `a`. Values must be finite and at least 0.
FT_HD inline void store_next_floats(double a, float* p) {
  const float rounded = float(a);
  uint32_t bits;
  memcpy(&bits, &rounded, 4);
  bits += bits < 0x7f800000u ? 1u : 0u;
  memcpy(p, &bits, 4);
}

FT_LANES_END

#endif  // toggled guard
