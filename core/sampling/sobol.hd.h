// Sample points: the first two Sobol dimensions, Owen-scrambled by hashing and padded to any number of pairs.
//
// Source: B. Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020: a point set of any dimension is made of
// 2-D Sobol points whose index order is shuffled, and whose coordinates are scrambled, anew for each pair
// (section 3, "padding"). The hash is of the form of Laine and Karras ("Stratified Sampling for Stochastic
// Transparency", EGSR 2011) with the constants of N. Vegdahl ("Building a Better LK Hash", 2021).
// The second dimension's generator matrix is the Pascal triangle modulo 2 (its entry (j, k) is C(k, j) mod 2), which is
// the product of five sparse factors because C(k, j) is odd exactly when the bits of j are a subset of those of k
// (Lucas): five masked xor-shifts replace 32 direction numbers.
//
// Properties: for any seed and any m, each aligned block of 2^m indices [i 2^m, (i + 1) 2^m) is a (0, m, 2)-net in
// base 2 of points with 24-bit coordinates.
// Thread-safety: pure functions, no memory access.

#if defined(FIELDTRACE_CORE_SAMPLING_SOBOL_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SAMPLING_SOBOL_HD_H_
#undef FIELDTRACE_CORE_SAMPLING_SOBOL_HD_H_
#else
#define FIELDTRACE_CORE_SAMPLING_SOBOL_HD_H_
#endif

#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

// An integer hash without low-order bias (C. Wellons' search for two-round multiply-xorshift hashes). A bijection; maps
// 0 to 0.
template <class U>
FT_HD_INLINE U hash_bits(U x, U multiplier0, U multiplier1) {
  x = x ^ shift_right<16>(x);
  x = x * multiplier0;
  x = x ^ shift_right<15>(x);
  x = x * multiplier1;
  return x ^ shift_right<15>(x);
}
template <class F>
FT_HD_INLINE Uint_t<F> hash_lanes(Uint_t<F> x) {
  return hash_bits(x, splat_uint<F>(0x21f0aaadu), splat_uint<F>(0xd35a2d97u));
}
FT_HD_INLINE uint32_t hash_uint(uint32_t x) { return hash_lanes<float>(x); }

// Hash of two words in order; chain it for more.
template <class F>
FT_HD_INLINE Uint_t<F> hash_combine_lanes(Uint_t<F> a, Uint_t<F> b) {
  const Uint_t<F> golden = splat_uint<F>(0x9e3779b9u);
  return hash_lanes<F>(a ^ (hash_lanes<F>(b + golden) + golden + shift_left<6>(a) + shift_right<2>(a)));
}
FT_HD_INLINE uint32_t hash_combine(uint32_t a, uint32_t b) { return hash_combine_lanes<float>(a, b); }

// The seed of a pixel.
template <class F>
FT_HD_INLINE Uint_t<F> pixel_seed_lanes(Uint_t<F> seed, Uint_t<F> x, Uint_t<F> y) {
  return hash_combine_lanes<F>(hash_combine_lanes<F>(seed, x), y);
}
FT_HD_INLINE uint32_t pixel_seed(uint32_t seed, uint32_t x, uint32_t y) { return pixel_seed_lanes<float>(seed, x, y); }

// The seed of a path vertex (0: the camera ray's hit) in a pixel, as held in ShadingPointBatch::seed.
FT_HD_INLINE uint32_t vertex_seed(uint32_t of_pixel, uint32_t vertex) { return hash_combine(of_pixel, vertex); }
FT_HD_INLINE uint32_t vertex_seed(uint32_t seed, uint32_t pixel_x, uint32_t pixel_y, uint32_t vertex) {
  return vertex_seed(pixel_seed(seed, pixel_x, pixel_y), vertex);
}

// The three independent scrambles of one pair of dimensions: index order, x and y.
template <class F>
struct SobolSeeds {
  Uint_t<F> order, x, y;
};

// Seeds of dimension pair number `dimension` of sequence `seed`.
template <class F>
FT_HD_INLINE SobolSeeds<F> sobol_seeds(Uint_t<F> seed, uint32_t dimension) {
  const Uint_t<F> order = hash_lanes<F>(seed + splat_uint<F>(hash_uint(dimension + 0x9e3779b9u)));
  const Uint_t<F> x = hash_lanes<F>(order + splat_uint<F>(0x9e3779b9u));
  const Uint_t<F> y = hash_lanes<F>(x + splat_uint<F>(0x9e3779b9u));
  return {order, x, y};
}

// Owen scrambling of a *bit-reversed* fraction: bit k of the result depends on bits 0..k of x only.
template <class F>
FT_HD_INLINE Uint_t<F> scramble_reversed(Uint_t<F> x, Uint_t<F> seed) {
  x = x ^ (x * splat_uint<F>(0x3d20adeau));
  x = x + seed;
  x = x * (shift_right<16>(seed) | splat_uint<F>(1u));
  x = x ^ (x * splat_uint<F>(0x05526c56u));
  return x ^ (x * splat_uint<F>(0x53a22864u));
}

// The second Sobol dimension of `index`, bit-reversed (the first dimension's is `index` itself): bit j of the result is
// the sum modulo 2 of the index bits k with C(k, j) odd.
template <class F>
FT_HD_INLINE Uint_t<F> sobol_second_reversed(Uint_t<F> index) {
  index = index ^ shift_right<16>(index);
  index = index ^ shift_right<8>(index & splat_uint<F>(0xff00ff00u));
  index = index ^ shift_right<4>(index & splat_uint<F>(0xf0f0f0f0u));
  index = index ^ shift_right<2>(index & splat_uint<F>(0xccccccccu));
  return index ^ shift_right<1>(index & splat_uint<F>(0xaaaaaaaau));
}

// A point of the unit square as 32-bit fractions.
template <class F>
struct FractionPair {
  Uint_t<F> x, y;
};

template <class F>
FT_HD_INLINE FractionPair<F> sample_2d_fractions(Uint_t<F> index, const SobolSeeds<F>& seeds) {
  const Uint_t<F> shuffled = reverse_bits(scramble_reversed<F>(reverse_bits(index), seeds.order));
  return {reverse_bits(scramble_reversed<F>(shuffled, seeds.x)),
          reverse_bits(scramble_reversed<F>(sobol_second_reversed<F>(shuffled), seeds.y))};
}

// A point of [0, 1)^2.
template <class F>
struct UnitPair {
  F x, y;
};

template <class F>
FT_HD_INLINE UnitPair<F> sample_2d(Uint_t<F> index, const SobolSeeds<F>& seeds) {
  const FractionPair<F> p = sample_2d_fractions<F>(index, seeds);
  return {unit_float(p.x), unit_float(p.y)};
}

// Point `index` of dimension pair number `dimension` of sequence `seed`, in [0, 1)^2.
FT_HD_INLINE UnitPair<float> sample_2d(uint32_t index, uint32_t seed, uint32_t dimension) {
  return sample_2d<float>(index, sobol_seeds<float>(seed, dimension));
}

FT_LANES_END

#endif  // toggled guard
