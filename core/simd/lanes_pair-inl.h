// Pairs of vectors as one lane type: twice the lanes, and two independent chains of arithmetic in flight.
//
// A field query is one long dependency chain. A processor overlaps neighbouring vectors only as far as its reorder
// window reaches, which is less than one query; two chains side by side use execution units that would be idle
// (docs/decisions/008-two-chains.md). Implements everything that lanes.hd.h requires of a lane type by applying it to
// both halves. Include only after lanes-inl.h. Thread-safety: values.

#if defined(FIELDTRACE_CORE_SIMD_LANES_PAIR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SIMD_LANES_PAIR_INL_H_
#undef FIELDTRACE_CORE_SIMD_LANES_PAIR_INL_H_
#else
#define FIELDTRACE_CORE_SIMD_LANES_PAIR_INL_H_
#endif

#include "core/simd/lanes-inl.h"

FT_LANES_BEGIN

template <class V>
struct Pair {
  V lo, hi;
};
using F32x2 = Pair<F32>;
using I32x2 = Pair<I32>;
using U32x2 = Pair<U32>;
using MaskLanesx2 = Pair<MaskLanes>;

template <>
struct Lanes<F32x2> {
  using Int = I32x2;
  using Uint = U32x2;
  using Mask = MaskLanesx2;
  static constexpr int k_count = 2 * Lanes<F32>::k_count;
};

template <>
HWY_INLINE F32x2 splat<F32x2>(float a) {
  return {splat<F32>(a), splat<F32>(a)};
}
template <>
HWY_INLINE I32x2 splat_int<F32x2>(int32_t a) {
  return {splat_int<F32>(a), splat_int<F32>(a)};
}
template <>
HWY_INLINE U32x2 splat_uint<F32x2>(uint32_t a) {
  return {splat_uint<F32>(a), splat_uint<F32>(a)};
}

template <class V>
HWY_INLINE Pair<V> operator+(Pair<V> a, Pair<V> b) {
  return {a.lo + b.lo, a.hi + b.hi};
}
template <class V>
HWY_INLINE Pair<V> operator-(Pair<V> a, Pair<V> b) {
  return {a.lo - b.lo, a.hi - b.hi};
}
template <class V>
HWY_INLINE Pair<V> operator*(Pair<V> a, Pair<V> b) {
  return {a.lo * b.lo, a.hi * b.hi};
}
template <class V>
HWY_INLINE Pair<V> operator/(Pair<V> a, Pair<V> b) {
  return {a.lo / b.lo, a.hi / b.hi};
}
template <class V>
HWY_INLINE Pair<V> operator-(Pair<V> a) {
  return {-a.lo, -a.hi};
}
template <class V>
HWY_INLINE Pair<V> operator&(Pair<V> a, Pair<V> b) {
  return {a.lo & b.lo, a.hi & b.hi};
}
template <class V>
HWY_INLINE Pair<V> operator|(Pair<V> a, Pair<V> b) {
  return {a.lo | b.lo, a.hi | b.hi};
}
HWY_INLINE MaskLanesx2 operator!(MaskLanesx2 a) { return {!a.lo, !a.hi}; }
template <class V>
HWY_INLINE MaskLanesx2 operator<(Pair<V> a, Pair<V> b) {
  return {a.lo < b.lo, a.hi < b.hi};
}
template <class V>
HWY_INLINE MaskLanesx2 operator<=(Pair<V> a, Pair<V> b) {
  return {a.lo <= b.lo, a.hi <= b.hi};
}
template <class V>
HWY_INLINE MaskLanesx2 operator>(Pair<V> a, Pair<V> b) {
  return {a.lo > b.lo, a.hi > b.hi};
}
template <class V>
HWY_INLINE MaskLanesx2 operator>=(Pair<V> a, Pair<V> b) {
  return {a.lo >= b.lo, a.hi >= b.hi};
}
template <class V>
HWY_INLINE MaskLanesx2 operator==(Pair<V> a, Pair<V> b) {
  return {a.lo == b.lo, a.hi == b.hi};
}

HWY_INLINE MaskLanesx2 and_not(MaskLanesx2 a, MaskLanesx2 b) { return {and_not(a.lo, b.lo), and_not(a.hi, b.hi)}; }
template <class V>
HWY_INLINE Pair<V> min(Pair<V> a, Pair<V> b) {
  return {min(a.lo, b.lo), min(a.hi, b.hi)};
}
template <class V>
HWY_INLINE Pair<V> max(Pair<V> a, Pair<V> b) {
  return {max(a.lo, b.lo), max(a.hi, b.hi)};
}
HWY_INLINE F32x2 sqrt(F32x2 a) { return {sqrt(a.lo), sqrt(a.hi)}; }
HWY_INLINE F32x2 floor(F32x2 a) { return {floor(a.lo), floor(a.hi)}; }
HWY_INLINE F32x2 abs(F32x2 a) { return {abs(a.lo), abs(a.hi)}; }
HWY_INLINE F32x2 copysign(F32x2 a, F32x2 sign) { return {copysign(a.lo, sign.lo), copysign(a.hi, sign.hi)}; }
template <class V>
HWY_INLINE Pair<V> select(MaskLanesx2 m, Pair<V> a, Pair<V> b) {
  return {select(m.lo, a.lo, b.lo), select(m.hi, a.hi, b.hi)};
}
HWY_INLINE I32x2 small_to_int(F32x2 a) { return {small_to_int(a.lo), small_to_int(a.hi)}; }
HWY_INLINE F32x2 to_float(I32x2 a) { return {to_float(a.lo), to_float(a.hi)}; }
HWY_INLINE bool any(MaskLanesx2 m) { return any(MaskLanes(m.lo | m.hi)); }
HWY_INLINE int count_true(MaskLanesx2 m) { return count_true(m.lo) + count_true(m.hi); }
HWY_INLINE int sum_of(I32x2 a) { return sum_of(a.lo + a.hi); }
HWY_INLINE int compress_store(I32x2 a, MaskLanesx2 m, int32_t* p) {
  const int n = compress_store(a.lo, m.lo, p);
  return n + compress_store(a.hi, m.hi, p + n);
}
template <int k_bits, class V>
HWY_INLINE Pair<V> shift_left(Pair<V> a) {
  return {shift_left<k_bits>(a.lo), shift_left<k_bits>(a.hi)};
}
template <int k_bits, class V>
HWY_INLINE Pair<V> shift_right(Pair<V> a) {
  return {shift_right<k_bits>(a.lo), shift_right<k_bits>(a.hi)};
}

template <>
HWY_INLINE F32x2 load_lanes<F32x2>(const float* p) {
  return {load(p), load(p + Lanes<F32>::k_count)};
}
template <>
HWY_INLINE U32x2 load_byte_lanes<F32x2>(const uint8_t* p) {
  return {load_byte_lanes<F32>(p), load_byte_lanes<F32>(p + Lanes<F32>::k_count)};
}
template <>
HWY_INLINE U32x2 load_uint_lanes<F32x2>(const uint32_t* p) {
  return {load(p), load(p + Lanes<F32>::k_count)};
}
template <>
HWY_INLINE I32x2 load_int_lanes<F32x2>(const int32_t* p) {
  return {load(p), load(p + Lanes<F32>::k_count)};
}
template <>
HWY_INLINE I32x2 lane_sequence<F32x2>(int32_t first) {
  return {lane_sequence<F32>(first), lane_sequence<F32>(first + Lanes<F32>::k_count)};
}
HWY_INLINE void store_lanes(F32x2 a, float* p) {
  store(a.lo, p);
  store(a.hi, p + Lanes<F32>::k_count);
}
HWY_INLINE void store_lanes(I32x2 a, int32_t* p) {
  store(a.lo, p);
  store(a.hi, p + Lanes<F32>::k_count);
}
HWY_INLINE void store_lanes(U32x2 a, uint32_t* p) {
  store(a.lo, p);
  store(a.hi, p + Lanes<F32>::k_count);
}
HWY_INLINE I32x2 gather(const int32_t* base, I32x2 index) { return {gather(base, index.lo), gather(base, index.hi)}; }
HWY_INLINE F32x2 gather(const float* base, I32x2 index) { return {gather(base, index.lo), gather(base, index.hi)}; }
HWY_INLINE I32x2 gather_bytes(const uint8_t* base, I32x2 offset) {
  return {gather_bytes(base, offset.lo), gather_bytes(base, offset.hi)};
}

FT_LANES_END

#endif  // toggled guard
