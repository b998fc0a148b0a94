// Precomputed sets of scrambled Sobol points, from which light sampling takes its points by table look-up and exclusive
// or.
//
// Source: J. Matousek, "On the L2-Discrepancy for Anchored Boxes", Journal of Complexity 14, 1998: a *random linear
// scramble* multiplies each coordinate's digits by a random lower triangular matrix with a unit diagonal. With a random
// digital shift (exclusive or), its points have the same pairwise distribution, and hence the same variance of every
// estimate, as Owen's nested scramble (A. Owen, "Variance with Alternative Scramblings of Digital Nets", ACM TOMACS
// 13(4), 2003). Since everything is linear over bits, point i is the exclusive or of one word per byte of i. Each set
// has two matrices of its own; a sequence picks a set and a shift by hash (point_sets.hd.h). How many sets suffice, and
// the cost of alternatives: docs/decisions/006-sample-points.md.
//
// Memory layout: set s is k_set_words words from s * k_set_words: the 256 words of an index' low byte, then those of
// the next byte. A word holds 16 binary digits of x in its lower half and 16 of y in its upper half, the first digit
// highest. The same 128 KB for every scene. Thread-safety: pure; the table is const once made.
#pragma once

#include <cstdint>

#include "core/platform/aligned_vector.h"

namespace fieldtrace {

inline constexpr uint32_t k_point_sets = 64;  // a power of two
inline constexpr uint32_t k_set_bytes = 2;    // bytes of the index that the words cover
inline constexpr uint32_t k_set_words = k_set_bytes * 256;

AlignedVector<int32_t> make_point_sets();

}  // namespace fieldtrace
