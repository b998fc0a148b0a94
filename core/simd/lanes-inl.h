// Lane types over Highway vectors: F32, I32, U32, MaskLanes with the operators and functions of lanes.hd.h.
//
// Include only after foreach_target.h, once per target. Vectors have at most 16 lanes; k_count is the target's number
// (16 on AVX-512, 8 on AVX2, 4 on SSE4 and NEON). Loads and stores are aligned to the vector.
// Thread-safety: values.

#if defined(FIELDTRACE_CORE_SIMD_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SIMD_LANES_INL_H_
#undef FIELDTRACE_CORE_SIMD_LANES_INL_H_
#else
#define FIELDTRACE_CORE_SIMD_LANES_INL_H_
#endif

#include <hwy/highway.h>

#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;

struct MaskLanes {
  hn::Mask<DF> m;
};
struct F32 {
  hn::Vec<DF> v;
};
struct I32 {
  hn::Vec<DI> v;
};
struct U32 {
  hn::Vec<DU> v;
};

template <>
struct Lanes<F32> {
  using Int = I32;
  using Uint = U32;
  using Mask = MaskLanes;
  static constexpr int k_count = int(hn::MaxLanes(DF()));
};

template <>
inline F32 splat<F32>(float a) {
  return {hn::Set(DF(), a)};
}
template <>
inline I32 splat_int<F32>(int32_t a) {
  return {hn::Set(DI(), a)};
}
template <>
inline U32 splat_uint<F32>(uint32_t a) {
  return {hn::Set(DU(), a)};
}

HWY_INLINE F32 load(const float* p) { return {hn::Load(DF(), p)}; }
HWY_INLINE I32 load(const int32_t* p) { return {hn::Load(DI(), p)}; }
HWY_INLINE U32 load(const uint32_t* p) { return {hn::Load(DU(), p)}; }
HWY_INLINE void store(F32 a, float* p) { hn::Store(a.v, DF(), p); }
HWY_INLINE void store(I32 a, int32_t* p) { hn::Store(a.v, DI(), p); }
HWY_INLINE void store(U32 a, uint32_t* p) { hn::Store(a.v, DU(), p); }

HWY_INLINE F32 operator+(F32 a, F32 b) { return {a.v + b.v}; }
HWY_INLINE F32 operator-(F32 a, F32 b) { return {a.v - b.v}; }
HWY_INLINE F32 operator*(F32 a, F32 b) { return {a.v * b.v}; }
HWY_INLINE F32 operator/(F32 a, F32 b) { return {a.v / b.v}; }
HWY_INLINE F32 operator-(F32 a) { return {hn::Neg(a.v)}; }
HWY_INLINE MaskLanes operator<(F32 a, F32 b) { return {hn::Lt(a.v, b.v)}; }
HWY_INLINE MaskLanes operator<=(F32 a, F32 b) { return {hn::Le(a.v, b.v)}; }
HWY_INLINE MaskLanes operator>(F32 a, F32 b) { return {hn::Gt(a.v, b.v)}; }
HWY_INLINE MaskLanes operator>=(F32 a, F32 b) { return {hn::Ge(a.v, b.v)}; }
HWY_INLINE MaskLanes operator==(F32 a, F32 b) { return {hn::Eq(a.v, b.v)}; }

HWY_INLINE I32 operator+(I32 a, I32 b) { return {a.v + b.v}; }
HWY_INLINE I32 operator-(I32 a, I32 b) { return {a.v - b.v}; }
HWY_INLINE I32 operator*(I32 a, I32 b) { return {a.v * b.v}; }
HWY_INLINE I32 operator&(I32 a, I32 b) { return {hn::And(a.v, b.v)}; }
HWY_INLINE I32 operator|(I32 a, I32 b) { return {hn::Or(a.v, b.v)}; }
HWY_INLINE MaskLanes operator<(I32 a, I32 b) { return {hn::RebindMask(DF(), hn::Lt(a.v, b.v))}; }
HWY_INLINE MaskLanes operator>(I32 a, I32 b) { return {hn::RebindMask(DF(), hn::Gt(a.v, b.v))}; }
HWY_INLINE MaskLanes operator==(I32 a, I32 b) { return {hn::RebindMask(DF(), hn::Eq(a.v, b.v))}; }

HWY_INLINE U32 operator+(U32 a, U32 b) { return {a.v + b.v}; }
HWY_INLINE U32 operator*(U32 a, U32 b) { return {a.v * b.v}; }
HWY_INLINE U32 operator&(U32 a, U32 b) { return {hn::And(a.v, b.v)}; }
HWY_INLINE U32 operator|(U32 a, U32 b) { return {hn::Or(a.v, b.v)}; }
HWY_INLINE U32 operator^(U32 a, U32 b) { return {hn::Xor(a.v, b.v)}; }
HWY_INLINE MaskLanes operator==(U32 a, U32 b) { return {hn::RebindMask(DF(), hn::Eq(a.v, b.v))}; }

HWY_INLINE MaskLanes operator&(MaskLanes a, MaskLanes b) { return {hn::And(a.m, b.m)}; }
HWY_INLINE MaskLanes operator|(MaskLanes a, MaskLanes b) { return {hn::Or(a.m, b.m)}; }
HWY_INLINE MaskLanes operator!(MaskLanes a) { return {hn::Not(a.m)}; }
HWY_INLINE MaskLanes and_not(MaskLanes a, MaskLanes b) { return {hn::AndNot(a.m, b.m)}; }

// The arguments are swapped because x86 returns its second operand for equal zeros (and NaNs): the results for -0 and
// +0 then match the scalar min and max.
HWY_INLINE F32 min(F32 a, F32 b) { return {hn::Min(b.v, a.v)}; }
HWY_INLINE F32 max(F32 a, F32 b) { return {hn::Max(b.v, a.v)}; }
HWY_INLINE I32 min(I32 a, I32 b) { return {hn::Min(a.v, b.v)}; }
HWY_INLINE I32 max(I32 a, I32 b) { return {hn::Max(a.v, b.v)}; }
HWY_INLINE F32 sqrt(F32 a) { return {hn::Sqrt(a.v)}; }
HWY_INLINE F32 floor(F32 a) { return {hn::Floor(a.v)}; }
HWY_INLINE F32 abs(F32 a) { return {hn::Abs(a.v)}; }
HWY_INLINE F32 copysign(F32 magnitude, F32 sign) { return {hn::CopySign(magnitude.v, sign.v)}; }
HWY_INLINE F32 select(MaskLanes m, F32 a, F32 b) { return {hn::IfThenElse(m.m, a.v, b.v)}; }
HWY_INLINE I32 select(MaskLanes m, I32 a, I32 b) { return {hn::IfThenElse(hn::RebindMask(DI(), m.m), a.v, b.v)}; }
HWY_INLINE U32 select(MaskLanes m, U32 a, U32 b) { return {hn::IfThenElse(hn::RebindMask(DU(), m.m), a.v, b.v)}; }
HWY_INLINE I32 to_int(F32 a) { return {hn::ConvertTo(DI(), a.v)}; }
// For a whole number in [0, 2^23): added to 2^23, it appears in the low bits. (ConvertTo also handles overflow, which
// costs more.)
HWY_INLINE I32 small_to_int(F32 a) {
  const auto bits = hn::BitCast(DI(), a.v + hn::Set(DF(), 0x1p23f));
  return {hn::And(bits, hn::Set(DI(), 0x7fffff))};
}
HWY_INLINE F32 to_float(I32 a) { return {hn::ConvertTo(DF(), a.v)}; }
HWY_INLINE U32 as_uint(I32 a) { return {hn::BitCast(DU(), a.v)}; }
HWY_INLINE I32 as_int(U32 a) { return {hn::BitCast(DI(), a.v)}; }
HWY_INLINE bool any(MaskLanes m) { return !hn::AllFalse(DF(), m.m); }
HWY_INLINE bool all(MaskLanes m) { return hn::AllTrue(DF(), m.m); }

HWY_INLINE int count_true(MaskLanes m) { return int(hn::CountTrue(DF(), m.m)); }
HWY_INLINE int sum_of(I32 a) { return int(hn::GetLane(hn::SumOfLanes(DI(), a.v))); }

// Stores the lanes of `a` where m is set contiguously from p; returns their number. p has room for a whole vector.
HWY_INLINE int compress_store(I32 a, MaskLanes m, int32_t* p) {
  return int(hn::CompressStore(a.v, hn::RebindMask(DI(), m.m), DI(), p));
}

template <int k_bits>
HWY_INLINE U32 shift_left(U32 a) {
  return {hn::ShiftLeft<k_bits>(a.v)};
}
template <int k_bits>
HWY_INLINE U32 shift_right(U32 a) {
  return {hn::ShiftRight<k_bits>(a.v)};
}
template <int k_bits>
HWY_INLINE I32 shift_left(I32 a) {
  return {hn::ShiftLeft<k_bits>(a.v)};
}
template <int k_bits>
HWY_INLINE I32 shift_right(I32 a) {
  return {hn::ShiftRight<k_bits>(a.v)};
}

HWY_INLINE F32 unit_float(U32 a) { return to_float(as_int(shift_right<8>(a))) * splat<F32>(0x1p-24f); }

#if HWY_TARGET == HWY_SCALAR  // has no byte vectors
HWY_INLINE U32 reverse_bits(U32 a) { return {hn::Set(DU(), reverse_bits(hn::GetLane(a.v)))}; }
#else
// Bits within each byte by two nibble look-ups, then the bytes of each lane.
HWY_INLINE U32 reverse_bits(U32 a) {
  const hn::Repartition<uint8_t, DU> d8;
  HWY_ALIGN static constexpr uint8_t k_low[16] = {0x00, 0x80, 0x40, 0xc0, 0x20, 0xa0, 0x60, 0xe0,
                                                  0x10, 0x90, 0x50, 0xd0, 0x30, 0xb0, 0x70, 0xf0};
  HWY_ALIGN static constexpr uint8_t k_high[16] = {0x0, 0x8, 0x4, 0xc, 0x2, 0xa, 0x6, 0xe,
                                                   0x1, 0x9, 0x5, 0xd, 0x3, 0xb, 0x7, 0xf};
  HWY_ALIGN static constexpr uint8_t k_swap[16] = {3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12};
  const auto nibble = hn::Set(DU(), 0x0f0f0f0fu);
  const auto low = hn::BitCast(d8, hn::And(a.v, nibble));
  const auto high = hn::BitCast(d8, hn::And(hn::ShiftRight<4>(a.v), nibble));
  const auto reversed = hn::Or(hn::TableLookupBytes(hn::LoadDup128(d8, k_low), low),
                               hn::TableLookupBytes(hn::LoadDup128(d8, k_high), high));
  return {hn::BitCast(DU(), hn::TableLookupBytes(reversed, hn::LoadDup128(d8, k_swap)))};
}
#endif

template <>
HWY_INLINE F32 load_lanes<F32>(const float* p) {
  return load(p);
}
template <>
HWY_INLINE U32 load_uint_lanes<F32>(const uint32_t* p) {
  return load(p);
}
template <>
HWY_INLINE U32 load_byte_lanes<F32>(const uint8_t* p) {
  const hn::Rebind<uint8_t, DU> d8;
  return {hn::PromoteTo(DU(), hn::LoadU(d8, p))};
}
HWY_INLINE void store_lanes(F32 a, float* p) { store(a, p); }
HWY_INLINE void store_lanes(I32 a, int32_t* p) { store(a, p); }
HWY_INLINE void store_lanes(U32 a, uint32_t* p) { store(a, p); }
template <>
HWY_INLINE I32 load_int_lanes<F32>(const int32_t* p) {
  return load(p);
}
template <>
HWY_INLINE I32 load_int_lanes_unaligned<F32>(const int32_t* p) {
  return {hn::LoadU(DI(), p)};
}
// first, first + 1, ...
template <>
HWY_INLINE I32 lane_sequence<F32>(int32_t first) {
  return {hn::Iota(DI(), first)};
}

template <>
struct LanePermutation<F32> {
  // `index` is aligned to the vector.
  HWY_INLINE explicit LanePermutation(const int32_t* index) : v(hn::Load(DI(), index)) {}
  HWY_INLINE F32 operator()(F32 a) const { return {hn::TableLookupLanes(a.v, hn::IndicesFromVec(DF(), v))}; }
  HWY_INLINE U32 operator()(U32 a) const { return {hn::TableLookupLanes(a.v, hn::IndicesFromVec(DU(), v))}; }
  hn::Vec<DI> v;
};

HWY_INLINE I32 gather(const int32_t* base, I32 index) { return {hn::GatherIndex(DI(), base, index.v)}; }
HWY_INLINE F32 gather(const float* base, I32 index) { return {hn::GatherIndex(DF(), base, index.v)}; }
// Reads 4 bytes at base + byte_offset in each lane; the buffer must extend 3 bytes past the last byte wanted.
HWY_INLINE I32 gather_bytes(const uint8_t* base, I32 byte_offset) {
  return {hn::GatherOffset(DI(), reinterpret_cast<const int32_t*>(base), byte_offset.v)};
}

FT_LANES_END

#endif  // toggled guard
