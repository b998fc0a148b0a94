// How cells are packed: bricks of 512 cells, their slices, and the bits of a cell. Shared by CPU and GPU.
//
// A brick is 4 x 4 directions by 4 x 8 plane cells; a slice is the 32 plane cells of one direction in a brick,
// consecutive in memory, and the unit of demand. Within a brick: index = ((u & 3) * 4 + (v & 3)) * 32 + (a & 3) * 8 +
// (b & 7). Two-level table: top[direction brick] -> page; page[plane brick] -> brick. Page 0 and brick 0 are all zero,
// so that what was never baked reads as "unknown" without a branch.
//
// Layers, each addressed by brick * 512 + cell:
// - visibility, 1 byte: 0 unknown, else 1 + verdict + 2 * risk class. verdict 1: lines through the cell hit the object.
//   Only lines of the upper half of the directions are stored: a line and its reverse share a cell.
// - depth, 4 bytes: bits 0-15 depth along the cell's direction, [-1, 1]; 16-23 and 24-31 octahedral normal.
// - certificate, 4 bytes: 0 unknown, else bits 0-1 kind, 2-7 risk class, 8-15 error bound. Kinds: 1 miss; 2 plane fit:
//   every line meets the plane within the error bound; 3 one-sided bound: no line meets anything in front of the plane
//   by more than the error bound, but some meet something behind it, or nothing.
// - primitive, 4 bytes: 0 unknown, 1 none, else 2 + the triangle met by the line through the cell's centre.
// Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_STORE_LAYOUT_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_STORE_LAYOUT_HD_H_
#undef FIELDTRACE_FIELD_STORE_LAYOUT_HD_H_
#else
#define FIELDTRACE_FIELD_STORE_LAYOUT_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/chart/chart.hd.h"
#include "field/store/view.h"

FT_LANES_BEGIN

constexpr int k_brick_cells = 512;
constexpr int k_slice_cells = 32;
constexpr int k_no_primitive = 1;
constexpr int k_first_primitive = 2;
constexpr int k_kind_miss = 1;
constexpr int k_kind_plane_fit = 2;
constexpr int k_kind_one_sided = 3;

// Where a cell is stored, and the number of its slice.
template <class F>
struct CellSlot {
  Int_t<F> cell;   // brick * 512 + index in the brick; below 512 where no brick exists
  Int_t<F> slice;  // (direction brick * 16 + direction in the brick) * plane_bricks + plane brick
};

template <class F>
FT_HD_INLINE CellSlot<F> slot_of(const FieldView& field, const CellAddress<F>& at) {
  const Int_t<F> three = splat_int<F>(3), seven = splat_int<F>(7);
  const Int_t<F> direction_brick = shift_right<2>(at.u) * splat_int<F>(field.direction_bricks) + shift_right<2>(at.v);
  const Int_t<F> direction_in_brick = shift_left<2>(at.u & three) + (at.v & three);
  const Int_t<F> plane_brick = shift_right<2>(at.a) * splat_int<F>(field.plane_bricks_b) + shift_right<3>(at.b);
  const Int_t<F> plane_in_brick = shift_left<3>(at.a & three) + (at.b & seven);
  const Int_t<F> page = gather(field.top, direction_brick);
  const Int_t<F> brick = gather(field.pages, page * splat_int<F>(field.plane_bricks) + plane_brick);
  CellSlot<F> slot;
  slot.cell = shift_left<9>(brick) + shift_left<5>(direction_in_brick) + plane_in_brick;
  slot.slice = (shift_left<4>(direction_brick) + direction_in_brick) * splat_int<F>(field.plane_bricks) + plane_brick;
  return slot;
}

// ---- depth in [-1, 1] as 16 bits

constexpr float k_depth_quantum = 2.0f / 65535.0f;

template <class F>
FT_HD_INLINE F decode_depth(Int_t<F> word) {
  return to_float(word & splat_int<F>(0xffff)) * splat<F>(k_depth_quantum) - splat<F>(1.0f);
}

// ---- unit normal as a plain octahedral map of 2 x 8 bits (Cigolle et al., JCGT 2014)

template <class F>
FT_HD_INLINE Vec3Lanes<F> decode_normal(Int_t<F> word) {
  const Int_t<F> byte = splat_int<F>(0xff);
  const F scale = splat<F>(2.0f / 255.0f), one = splat<F>(1.0f);
  const F x = to_float(shift_right<16>(word) & byte) * scale - one;
  const F y = to_float(shift_right<24>(word) & byte) * scale - one;
  const F z = one - abs(x) - abs(y);
  const F fold = max(splat<F>(0.0f) - z, splat<F>(0.0f));
  const F fx = x - copysign(fold, x);
  const F fy = y - copysign(fold, y);
  const F inverse_length = one / sqrt(fx * fx + fy * fy + z * z);
  return {fx * inverse_length, fy * inverse_length, z * inverse_length};
}

// ---- error bound as 8 bits: e = 2^(code / 16 - 16) (1 + (code mod 16) / 16), from 1.5e-5 to 0.97 of the radius, in
// steps of 3 to 6 %. Powers of two by multiplication rather than exp2, so that all machines agree.

template <class F>
FT_HD_INLINE F decode_error(Int_t<F> certificate) {
  const Int_t<F> code = shift_right<8>(certificate) & splat_int<F>(0xff);
  const F mantissa = to_float(code & splat_int<F>(15)) * splat<F>(1.0f / 16.0f) + splat<F>(1.0f);
  // 2^(code / 16 - 16), by repeated squaring on the bits of code / 16 (0 ... 15).
  const Int_t<F> exponent = shift_right<4>(code);
  const Int_t<F> zero = splat_int<F>(0);
  F power = splat<F>(0x1p-16f);
  power = select((exponent & splat_int<F>(1)) > zero, power * splat<F>(2.0f), power);
  power = select((exponent & splat_int<F>(2)) > zero, power * splat<F>(4.0f), power);
  power = select((exponent & splat_int<F>(4)) > zero, power * splat<F>(16.0f), power);
  power = select((exponent & splat_int<F>(8)) > zero, power * splat<F>(256.0f), power);
  return power * mantissa;
}

FT_LANES_END

#endif  // toggled guard
