// Points of a precomputed set under a digital shift: the sample points of lights. See point_sets.h.
//
// Index i of a sequence is the exclusive or of two words of the set, one for each of its low bytes, with the sequence's
// shifts. Digits beyond the words' 16 come from the shift. Sequences longer than 2^16 continue with the same points
// under further shifts, one per block of that length.
// Two sequences of one pixel are independent in their sets and shifts but traverse their nets in the same order.
// Whatever is sampled jointly with the light (film, lens, material) has its order shuffled (sobol.hd.h), which is
// enough, as shuffling both is equivalent to shuffling one.
// Thread-safety: pure functions that read the table.

#if defined(FIELDTRACE_CORE_SAMPLING_POINT_SETS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SAMPLING_POINT_SETS_HD_H_
#undef FIELDTRACE_CORE_SAMPLING_POINT_SETS_HD_H_
#else
#define FIELDTRACE_CORE_SAMPLING_POINT_SETS_HD_H_
#endif

#include "core/sampling/point_sets.h"
#include "core/sampling/sobol.hd.h"
#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

// A sequence: the table offset of its set's first word, and shifts whose lowest 8 bits are zero.
template <class F>
struct SetSequence {
  Uint_t<F> set, shift_x, shift_y;
};

// The `stream` argument of set_sequence for sequence number `dimension`, common to all seeds.
FT_HD_INLINE uint32_t set_stream(uint32_t dimension) { return hash_uint(dimension + 0x9e3779b9u); }

template <class F>
FT_HD_INLINE SetSequence<F> set_sequence(Uint_t<F> seed, uint32_t stream) {
  const Uint_t<F> shift_mask = splat_uint<F>(0xffffff00u);  // 24 digits: a float's significand
  const Uint_t<F> x = hash_lanes<F>(seed + splat_uint<F>(stream));
  const Uint_t<F> y = hash_lanes<F>(x + splat_uint<F>(0x9e3779b9u));
  return {(y & splat_uint<F>(k_point_sets - 1)) * splat_uint<F>(k_set_words), x & shift_mask, y & shift_mask};
}
static_assert(k_point_sets <= 256, "the set is chosen by the bits that the shift leaves");

// A point of [-1, 1)^2, its coordinates multiples of 2^-23; (x + 1) / 2 is exact.
template <class F>
struct CentredPair {
  F x, y;
};

// From the point's word. The top digit becomes the sign, which swaps the two halves of the interval harmlessly.
template <class F>
FT_HD_INLINE CentredPair<F> centred_point(Uint_t<F> word, Uint_t<F> shift_x, Uint_t<F> shift_y) {
  const Uint_t<F> x = shift_left<16>(word) ^ shift_x;
  const Uint_t<F> y = (word & splat_uint<F>(0xffff0000u)) ^ shift_y;
  return {to_float(as_int(x)) * splat<F>(0x1p-31f), to_float(as_int(y)) * splat<F>(0x1p-31f)};
}

// Centre of cell k of a grid of `columns` x `rows` cells over [-1, 1)^2, row by row. k < 2^20.
template <class F>
FT_HD_INLINE CentredPair<F> grid_point(Uint_t<F> k, int columns, int rows) {
  const F number = to_float(as_int(k)), one = splat<F>(1.0f);
  // Half a cell away from the next whole number, more than rounding can bridge.
  const F row = floor((number + splat<F>(0.5f)) * splat<F>(1.0f / float(columns)));
  const F column = number - row * splat<F>(float(columns));
  return {(column + column + one) * splat<F>(1.0f / float(columns)) - one,
          (row + row + one) * splat<F>(1.0f / float(rows)) - one};
}

// Further shifts for block index >> 16 of a long sequence; none for block 0.
template <class F>
FT_HD_INLINE void shift_block(Uint_t<F> block, SetSequence<F>& s) {
  const Uint_t<F> shift_mask = splat_uint<F>(0xffffff00u);
  const Uint_t<F> x = hash_lanes<F>(block);
  s.shift_x = s.shift_x ^ (x & shift_mask);
  s.shift_y = s.shift_y ^ (hash_lanes<F>(x * splat_uint<F>(0x9e3779b9u)) & shift_mask);
}

// Point index[l] of the sequence in lane l.
template <class F>
FT_HD_INLINE CentredPair<F> gather_point(const int32_t* sets, SetSequence<F> s, Uint_t<F> index) {
  const Uint_t<F> byte = splat_uint<F>(0xffu), zero = splat_uint<F>(0u);
  Uint_t<F> word = as_uint(gather(sets, as_int(s.set + (index & byte))));
  const Uint_t<F> high = shift_right<8>(index);
  if (!all(high == zero)) {
    word = word ^ as_uint(gather(sets + 256, as_int(s.set + (high & byte))));
    shift_block<F>(shift_right<8>(high), s);
  }
  return centred_point<F>(word, s.shift_x, s.shift_y);
}

// Points index, index + 1, ... of one sequence, all within one block of 256 indices. `set` is s.set, equal in all
// lanes.
template <class F>
FT_HD_INLINE CentredPair<F> load_points(const int32_t* sets, uint32_t set, SetSequence<F> s, uint32_t index) {
  const int32_t* words = sets + set;
  Uint_t<F> word = as_uint(load_int_lanes_unaligned<F>(words + (index & 255)));
  if (index >= 256) {
    word = word ^ splat_uint<F>(uint32_t(words[256 + ((index >> 8) & 255)]));
    if (index >= 65536) shift_block<F>(splat_uint<F>(index >> 16), s);
  }
  return centred_point<F>(word, s.shift_x, s.shift_y);
}

FT_LANES_END

#endif  // toggled guard
