// What PTX instructions compute, by the PTX ISA (version 9.0), as functions that code made by ptx_to_cpp.py calls.
//
// Registers are bool (.pred), uint16_t, uint32_t, uint64_t, float and double; an instruction reads them as its own
// types and may write to a wider register. Arithmetic that yields NaN yields the GPU's canonical NaN. Thread-safety:
// pure functions, apart from loads and stores. Errors: PtxFault for what a GPU would stop at.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace fieldtrace::ptx {

class PtxFault : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

template <size_t k_bytes>
struct BitsOf;
template <>
struct BitsOf<2> {
  using type = uint16_t;
};
template <>
struct BitsOf<4> {
  using type = uint32_t;
};
template <>
struct BitsOf<8> {
  using type = uint64_t;
};

// A register or literal read as T: as many of its low bits as T has.
template <class T, class Register>
inline T get(Register r) {
  if constexpr (std::is_same_v<T, Register>) {
    return r;
  } else if constexpr (sizeof(T) == sizeof(Register)) {
    return std::bit_cast<T>(r);
  } else {
    static_assert(sizeof(T) < sizeof(Register) && std::is_integral_v<T>);
    return T(std::bit_cast<typename BitsOf<sizeof(Register)>::type>(r));
  }
}

// A result of type T as a register holds it: extended by its sign where it is narrower.
template <class Register, class T>
inline Register put(T value) {
  if constexpr (sizeof(T) == sizeof(Register)) {
    return std::bit_cast<Register>(value);
  } else {
    static_assert(sizeof(T) < sizeof(Register) && std::is_integral_v<T> && std::is_integral_v<Register>);
    return std::is_unsigned_v<T> ? Register(value) : Register(std::make_signed_t<Register>(value));
  }
}

inline float float_of(uint32_t bits) { return std::bit_cast<float>(bits); }
inline double double_of(uint64_t bits) { return std::bit_cast<double>(bits); }

template <class T>
inline bool is_nan(T a) {
  return std::isnan(a);
}
inline float canonical(float a) { return is_nan(a) ? float_of(0x7fffffffu) : a; }
inline double canonical(double a) { return is_nan(a) ? double_of(0x7fffffffffffffffull) : a; }

// ---- floats (T: float or double); all round to nearest, ties to even

template <class T>
inline T add(T a, T b) {
  return canonical(a + b);
}
template <class T>
inline T sub(T a, T b) {
  return canonical(a - b);
}
template <class T>
inline T mul(T a, T b) {
  return canonical(a * b);
}
template <class T>
inline T div(T a, T b) {
  return canonical(a / b);
}
template <class T>
inline T reciprocal(T a) {
  return canonical(T(1) / a);
}
template <class T>
inline T root(T a) {
  return canonical(std::sqrt(a));
}
template <class T>
inline T absolute(T a) {
  return canonical(std::fabs(a));
}
template <class T>
inline T negative(T a) {
  return canonical(-a);
}
// One NaN gives the other operand; +0 is more than -0.
template <class T>
inline T minimum(T a, T b) {
  if (is_nan(a) || is_nan(b)) return canonical(is_nan(a) ? b : a);
  if (a == b) return std::signbit(a) ? a : b;
  return a < b ? a : b;
}
template <class T>
inline T maximum(T a, T b) {
  if (is_nan(a) || is_nan(b)) return canonical(is_nan(a) ? b : a);
  if (a == b) return std::signbit(a) ? b : a;
  return a > b ? a : b;
}
// In PTX's order: the sign comes from the first operand.
template <class T>
inline T copy_sign(T sign, T magnitude) {
  return std::copysign(magnitude, sign);
}

enum class Rounding { nearest, zero, down, up };

template <Rounding k_rounding, class T>
inline T round_to_whole(T a) {
  if constexpr (k_rounding == Rounding::nearest) return canonical(std::nearbyint(a));
  if constexpr (k_rounding == Rounding::zero) return canonical(std::trunc(a));
  if constexpr (k_rounding == Rounding::down) return canonical(std::floor(a));
  return canonical(std::ceil(a));
}

// Saturates; NaN becomes 0, or the sign bit alone where either side has 64 bits.
template <class Int, Rounding k_rounding, class T>
inline Int to_whole(T a) {
  if (is_nan(a)) return sizeof(Int) == 8 || sizeof(T) == 8 ? Int(uint64_t(1) << (8 * sizeof(Int) - 1)) : Int(0);
  const T whole = round_to_whole<k_rounding>(a);
  const T end = std::ldexp(T(1), std::numeric_limits<Int>::digits);
  if (whole >= end) return std::numeric_limits<Int>::max();
  if (whole < T(std::numeric_limits<Int>::min())) return std::numeric_limits<Int>::min();
  return Int(whole);
}

// ---- integers: wrap around

template <class T>
inline T wrap(uint64_t a) {
  return T(a);
}
template <class T>
inline T shift_left(T a, uint32_t by) {
  return by >= 8 * sizeof(T) ? T(0) : T(std::make_unsigned_t<T>(a) << by);
}
// Amounts beyond the width count as the width.
template <class T>
inline T shift_right(T a, uint32_t by) {
  if (by >= 8 * sizeof(T)) return a < T(0) ? T(-1) : T(0);
  return T(a >> by);
}
template <class T>
inline T high_product(T a, T b) {
  static_assert(sizeof(T) == 4);
  return T((uint64_t(int64_t(a) * int64_t(b))) >> 32);
}
// Division by zero is unspecified; all bits are set, as hardware does.
template <class T>
inline T quotient(T a, T b) {
  if (b == 0) return T(-1);
  if (std::is_signed_v<T> && b == T(-1)) return wrap<T>(0 - uint64_t(a));
  return T(a / b);
}
template <class T>
inline T remainder(T a, T b) {
  if (b == 0) return a;
  if (std::is_signed_v<T> && b == T(-1)) return 0;
  return T(a % b);
}
template <class T>
inline uint32_t count_bits(T a) {
  return uint32_t(std::popcount(a));
}
template <class T>
inline uint32_t leading_zeros(T a) {
  return uint32_t(std::countl_zero(a));
}
inline uint32_t reversed(uint32_t a) {
  uint32_t b = 0;
  for (int i = 0; i < 32; ++i) b |= (a >> i & 1u) << (31 - i);
  return b;
}
// Bits [position, position + length) of a, beyond its width its sign (or 0), extended by the highest of them if signed.
template <class T>
inline T extract_bits(T a, uint32_t position, uint32_t length) {
  constexpr uint32_t k_width = 8 * sizeof(T);
  position &= 0xff, length &= 0xff;
  const uint32_t last = position + length - 1 < k_width - 1 ? position + length - 1 : k_width - 1;
  const bool sign = std::is_signed_v<T> && length > 0 && (uint64_t(a) >> last & 1u) != 0;
  T result = 0;
  for (uint32_t i = 0; i < k_width; ++i) {
    const bool inside = i < length && position + i < k_width;
    const bool bit = inside ? (uint64_t(a) >> (position + i) & 1u) != 0 : sign;
    if (bit) result = T(std::make_unsigned_t<T>(result) | std::make_unsigned_t<T>(1) << i);
  }
  return result;
}
// b with its bits [position, position + length) from the low ones of a.
template <class T>
inline T insert_bits(T a, T b, uint32_t position, uint32_t length) {
  position &= 0xff, length &= 0xff;
  for (uint32_t i = 0; i < length && position + i < 8 * sizeof(T); ++i) {
    const T bit = T(T(1) << (position + i));
    b = (a >> i & 1u) != 0 ? T(b | bit) : T(b & ~bit);
  }
  return b;
}
// Bytes of b:a by the selector's four nibbles, whose highest bit asks for the byte's sign instead.
inline uint32_t permute(uint32_t a, uint32_t b, uint32_t selector) {
  const uint64_t from = uint64_t(b) << 32 | a;
  uint32_t to = 0;
  for (uint32_t i = 0; i < 4; ++i) {
    const uint32_t nibble = selector >> (4 * i) & 15u;
    uint32_t byte = uint32_t(from >> (8 * (nibble & 7u))) & 0xffu;
    if (nibble & 8u) byte = byte & 0x80u ? 0xffu : 0u;
    to |= byte << (8 * i);
  }
  return to;
}
// The upper half of b:a << amount, and the lower half of b:a >> amount. wrap: of the amount modulo 32, else at most 32.
inline uint32_t funnel(bool left, bool wraps, uint32_t a, uint32_t b, uint32_t amount) {
  amount = wraps ? amount & 31u : amount < 32u ? amount : 32u;
  const uint64_t both = uint64_t(b) << 32 | a;
  return left ? uint32_t(both << amount >> 32) : uint32_t(both >> amount);
}

// ---- memory: generic addresses are those of this process

template <class T>
inline T load(uint64_t address, const char* name) {
  if (address % sizeof(T) != 0) throw PtxFault(std::string("misaligned ") + name);
  T value;
  std::memcpy(&value, std::bit_cast<const void*>(address), sizeof value);
  return value;
}
template <class T>
inline void store(uint64_t address, T value, const char* name) {
  if (address % sizeof(T) != 0) throw PtxFault(std::string("misaligned ") + name);
  std::memcpy(std::bit_cast<void*>(address), &value, sizeof value);
}
inline void require_aligned(uint64_t address, size_t bytes, const char* name) {
  if (address % bytes != 0) throw PtxFault(std::string("misaligned ") + name);
}

// ---- warps: a lane runs until it comes to an instruction that concerns other lanes, and waits there

enum class WarpOp { none, ballot, any, all, shuffle_xor, shuffle_up, shuffle_down, shuffle_index, barrier };

// The state of one lane between such instructions; registers are kept by the structure that derives from it.
struct Lane {
  static constexpr int k_exited = -1;
  int at = 0;  // the instruction that it waits at
  WarpOp op = WarpOp::none;
  uint32_t value = 0, operand = 0, clamp = 0, mask = 0;
  uint32_t result = 0;
  bool in_range = false;  // of a shuffle: the source lane exists
  uint32_t thread = 0, block = 0, blocks = 0;
  uint64_t arguments = 0;
};

inline constexpr int k_lanes = 32;

inline void exchange(Lane* const lanes[k_lanes]) {
  uint32_t votes = 0;
  for (int l = 0; l < k_lanes; ++l) votes |= uint32_t(lanes[l]->value != 0) << l;
  for (int l = 0; l < k_lanes; ++l) {
    Lane& lane = *lanes[l];
    int source = l;
    // The clamp operand: bits 0-4 the last lane, bits 8-12 the mask of segments (PTX ISA, shfl.sync).
    const int segment = int(lane.clamp >> 8 & 31u), clamp = int(lane.clamp & 31u), own = int(lane.operand & 31u);
    const int last = (l & segment) | (clamp & ~segment), first = l & segment;
    lane.in_range = true;
    switch (lane.op) {
      case WarpOp::ballot:
        lane.result = votes;
        continue;
      case WarpOp::any:
        lane.result = votes != 0;
        continue;
      case WarpOp::all:
        lane.result = votes == 0xffffffffu;
        continue;
      case WarpOp::shuffle_xor:
        source = l ^ own;
        lane.in_range = source <= last;
        break;
      case WarpOp::shuffle_up:
        source = l - own;
        lane.in_range = source >= last;
        break;
      case WarpOp::shuffle_down:
        source = l + own;
        lane.in_range = source <= last;
        break;
      case WarpOp::shuffle_index:
        source = first | (own & ~segment);
        lane.in_range = source <= last;
        break;
      case WarpOp::none:
      case WarpOp::barrier:
        continue;
    }
    lane.result = lanes[lane.in_range ? source : l]->value;
  }
}

// Runs a kernel of one warp a thread block. All lanes must come to the same exchange. at_end: called with the lanes of
// each warp that is done.
template <class LaneState, class AtEnd>
void run_blocks(void (*run)(LaneState&), const char* kernel, uint32_t blocks, const void* arguments,
                const AtEnd& at_end) {
  for (uint32_t block = 0; block < blocks; ++block) {
    LaneState states[k_lanes];
    Lane* lanes[k_lanes];
    for (int l = 0; l < k_lanes; ++l) {
      states[l].thread = uint32_t(l);
      states[l].block = block;
      states[l].blocks = blocks;
      states[l].arguments = uint64_t(std::bit_cast<uintptr_t>(arguments));
      lanes[l] = &states[l];
    }
    while (true) {
      for (LaneState& lane : states) run(lane);
      const int at = lanes[0]->at;
      for (const Lane* lane : lanes) {
        if (lane->at != at) throw PtxFault(std::string(kernel) + ": lanes of a warp wait at different instructions");
        if (at != Lane::k_exited && lane->mask != 0xffffffffu) throw PtxFault(std::string(kernel) + ": a partial warp");
      }
      if (at == Lane::k_exited) break;
      exchange(lanes);
    }
    at_end(states);
  }
}

template <class LaneState>
void run_blocks(void (*run)(LaneState&), const char* kernel, uint32_t blocks, const void* arguments) {
  run_blocks(run, kernel, blocks, arguments, [](const LaneState(&)[k_lanes]) {});
}

}  // namespace fieldtrace::ptx
