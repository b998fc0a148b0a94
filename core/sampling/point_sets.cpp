#include "core/sampling/point_sets.h"

#include <bit>

#include "core/sampling/sobol.hd.h"

namespace fieldtrace {
namespace {

constexpr uint32_t k_digits = 16;

// A random lower triangular matrix: row r gives digit r (the first is 0, at bit 15) as the sum of itself and a random
// choice of the digits before it.
struct Scramble {
  uint32_t rows[k_digits];

  explicit Scramble(uint32_t seed) {
    for (uint32_t r = 0; r < k_digits; ++r) {
      const uint32_t diagonal = 1u << (k_digits - 1 - r);
      const uint32_t before = 0xffffu & ~(2 * diagonal - 1);
      rows[r] = diagonal | (scalar::hash_combine(seed, r) & before);
    }
  }
  uint32_t operator()(uint32_t digits) const {
    uint32_t out = 0;
    for (uint32_t r = 0; r < k_digits; ++r) out = out * 2 + uint32_t(std::popcount(rows[r] & digits) & 1);
    return out;
  }
};

uint32_t first_digits(uint32_t reversed) { return scalar::reverse_bits(reversed) >> (32 - k_digits); }

}  // namespace

AlignedVector<int32_t> make_point_sets() {
  AlignedVector<int32_t> words(size_t(k_point_sets) * k_set_words, 0);
  for (uint32_t set = 0; set < k_point_sets; ++set) {
    const Scramble x(scalar::hash_combine(set, 0)), y(scalar::hash_combine(set, 1));
    int32_t* const out = words.data() + size_t(set) * k_set_words;
    for (uint32_t byte = 0; byte < k_set_bytes; ++byte) {
      for (uint32_t i = 1; i < 256; ++i) {
        const uint32_t lowest = i & (~i + 1);
        const uint32_t index = i << (8 * byte);
        out[byte * 256 + i] = i != lowest
                                  ? out[byte * 256 + (i ^ lowest)] ^ out[byte * 256 + lowest]
                                  : int32_t(x(first_digits(index)) |
                                            y(first_digits(scalar::sobol_second_reversed<float>(index))) << k_digits);
      }
    }
  }
  return words;
}

}  // namespace fieldtrace
