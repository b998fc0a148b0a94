// Lane types: the vocabulary for writing chart maths, sampling and look-ups once for scalar, SIMD and GPU code.
//
// Generic code is a template over a float lane type F (with Int_t<F>, Mask_t<F>) and uses only the operators + - * / <
// <= > >= == and the functions below. They are defined here for plain `float` (the reference, and each GPU thread),
// and in core/simd/lanes-inl.h for Highway vectors. This header and every *.hd.h built on it is included again for each
// Highway target, inside that target's namespace, so that code compiled for one instruction set is never linked into
// another.
//
// Exactness: every function here is correctly rounded or exact, so that all variants agree bit for bit.
// Thread-safety: pure functions.

// The include guard is toggled by Highway's foreach_target.h; without it this is an ordinary guard.
#if defined(FIELDTRACE_CORE_SIMD_LANES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SIMD_LANES_HD_H_
#undef FIELDTRACE_CORE_SIMD_LANES_HD_H_
#else
#define FIELDTRACE_CORE_SIMD_LANES_HD_H_
#endif

#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "core/platform/platform.h"
#include "core/simd/lane_namespace.h"

FT_LANES_BEGIN

// Lane counts and companion types: Lanes<float>::Int is int32_t; for vectors, the integer vector of the same length.
template <class F>
struct Lanes;
template <>
struct Lanes<float> {
  using Int = int32_t;
  using Uint = uint32_t;
  using Mask = bool;
  static constexpr int k_count = 1;
};
template <class F>
using Int_t = typename Lanes<F>::Int;
template <class F>
using Uint_t = typename Lanes<F>::Uint;
template <class F>
using Mask_t = typename Lanes<F>::Mask;

FT_HD inline float min(float a, float b) { return b < a ? b : a; }
FT_HD inline float max(float a, float b) { return a < b ? b : a; }
FT_HD inline int32_t min(int32_t a, int32_t b) { return b < a ? b : a; }
FT_HD inline int32_t max(int32_t a, int32_t b) { return a < b ? b : a; }
FT_HD inline float sqrt(float a) { return ::sqrtf(a); }
FT_HD inline float floor(float a) { return ::floorf(a); }
FT_HD inline float abs(float a) { return ::fabsf(a); }
FT_HD inline float copysign(float magnitude, float sign) { return ::copysignf(magnitude, sign); }
FT_HD inline float select(bool m, float a, float b) { return m ? a : b; }
FT_HD inline int32_t select(bool m, int32_t a, int32_t b) { return m ? a : b; }
FT_HD inline uint32_t select(bool m, uint32_t a, uint32_t b) { return m ? a : b; }
FT_HD inline int32_t to_int(float a) { return int32_t(a); }        // truncates; the caller keeps |a| < 2^31
FT_HD inline int32_t small_to_int(float a) { return int32_t(a); }  // a whole number in [0, 2^23)
FT_HD inline float to_float(int32_t a) { return float(a); }
FT_HD inline uint32_t as_uint(int32_t a) { return uint32_t(a); }
FT_HD inline int32_t as_int(uint32_t a) { return int32_t(a); }
FT_HD inline int count_true(bool m) { return m ? 1 : 0; }
FT_HD inline int sum_of(int32_t a) { return a; }
FT_HD inline bool any(bool m) { return m; }
FT_HD inline bool all(bool m) { return m; }
FT_HD inline bool and_not(bool a, bool b) { return !a && b; }  // (not a) and b, in Highway's argument order

// a * 2^-32 for a 32-bit fraction, truncated to the upper 24 bits so that the result is < 1.
FT_HD inline float unit_float(uint32_t a) { return float(int32_t(a >> 8)) * 0x1p-24f; }

template <int k_bits>
FT_HD inline uint32_t shift_left(uint32_t a) {
  return a << k_bits;
}
template <int k_bits>
FT_HD inline uint32_t shift_right(uint32_t a) {
  return a >> k_bits;
}
template <int k_bits>
FT_HD inline int32_t shift_left(int32_t a) {
  return int32_t(uint32_t(a) << k_bits);
}
template <int k_bits>
FT_HD inline int32_t shift_right(int32_t a) {
  return a >> k_bits;
}

// The 32 bits in the opposite order.
FT_HD inline uint32_t reverse_bits(uint32_t a) {
  a = ((a & 0x55555555u) << 1) | ((a >> 1) & 0x55555555u);
  a = ((a & 0x33333333u) << 2) | ((a >> 2) & 0x33333333u);
  a = ((a & 0x0f0f0f0fu) << 4) | ((a >> 4) & 0x0f0f0f0fu);
  a = ((a & 0x00ff00ffu) << 8) | ((a >> 8) & 0x00ff00ffu);
  return (a << 16) | (a >> 16);
}

// Look-ups read tables that other threads may be filling. A thread sanitizer reports such reads as races unless they
// are atomic; otherwise they are plain loads, as vector gathers are.
template <class T>
FT_HD inline T load_element(const T* p) {
#if defined(FT_THREAD_SANITIZER)
  T value;
  __atomic_load(p, &value, __ATOMIC_RELAXED);
  return value;
#else
  return *p;
#endif
}
// Loads before this call are not reordered with loads after it. No instruction on x86, which never reorders loads, and
// none on a GPU, whose fields do not change while it reads them.
FT_HD inline void order_loads() {
#if defined(FT_THREAD_SANITIZER)
  std::atomic_signal_fence(std::memory_order_acquire);  // the only fence that the sanitizer supports
#elif !defined(FT_DEVICE_PASS)
  std::atomic_thread_fence(std::memory_order_acquire);
#endif
}

FT_HD inline int32_t gather(const int32_t* base, int32_t index) { return load_element(base + index); }
FT_HD inline float gather(const float* base, int32_t index) { return load_element(base + index); }
FT_HD inline int32_t gather_bytes(const uint8_t* base, int32_t byte_offset) {
  int32_t word;
#if defined(FT_THREAD_SANITIZER)
  uint8_t bytes[4];  // bakers write single bytes
  for (int i = 0; i < 4; ++i) bytes[i] = load_element(base + byte_offset + i);
  memcpy(&word, bytes, 4);
#else
  memcpy(&word, base + byte_offset, 4);
#endif
  return word;
}

// Splat<F>(x): x in every lane.
template <class F>
FT_HD inline F splat(float a) {
  return F(a);
}
template <class F>
FT_HD inline Int_t<F> splat_int(int32_t a) {
  return Int_t<F>(a);
}
template <class F>
FT_HD inline Uint_t<F> splat_uint(uint32_t a) {
  return Uint_t<F>(a);
}

// Loads one value per lane from consecutive addresses; vectors need a pointer aligned to the vector (bytes: none).
template <class F>
FT_HD inline F load_lanes(const float* p) {
  return *p;
}
template <class F>
FT_HD inline Uint_t<F> load_uint_lanes(const uint32_t* p) {
  return *p;
}
template <class F>
FT_HD inline Uint_t<F> load_byte_lanes(const uint8_t* p) {
  return *p;
}
FT_HD inline void store_lanes(float a, float* p) { *p = a; }
FT_HD inline void store_lanes(uint32_t a, uint32_t* p) { *p = a; }
FT_HD inline void store_lanes(int32_t a, int32_t* p) { *p = a; }
template <class F>
FT_HD inline Int_t<F> load_int_lanes(const int32_t* p) {
  return *p;
}
// The same without alignment.
template <class F>
FT_HD inline Int_t<F> load_int_lanes_unaligned(const int32_t* p) {
  return *p;
}
// first, first + 1, ...
template <class F>
FT_HD inline Int_t<F> lane_sequence(int32_t first) {
  return first;
}
// Stores the lanes of `a` where m is set contiguously from p; returns their number. p has room for a whole vector.
FT_HD inline int compress_store(int32_t a, bool m, int32_t* p) {
  if (m) *p = a;
  return m ? 1 : 0;
}

// Lane l of the result is lane index[l] of the argument, index[l] in [0, lane count).
template <class F>
struct LanePermutation {
  FT_HD explicit LanePermutation(const int32_t*) {}
  FT_HD F operator()(F a) const { return a; }
  FT_HD Uint_t<F> operator()(Uint_t<F> a) const { return a; }
};

// A 3-D vector in each lane: one lane vector per component.
template <class F>
struct Vec3Lanes {
  F x, y, z;
};
template <class F>
FT_HD inline F dot(const Vec3Lanes<F>& a, const Vec3Lanes<F>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class F>
FT_HD inline Vec3Lanes<F> cross(const Vec3Lanes<F>& a, const Vec3Lanes<F>& b) {
  return {a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y};
}
template <class F>
FT_HD inline Vec3Lanes<F> operator+(const Vec3Lanes<F>& a, const Vec3Lanes<F>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class F>
FT_HD inline Vec3Lanes<F> operator-(const Vec3Lanes<F>& a, const Vec3Lanes<F>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class F>
FT_HD inline Vec3Lanes<F> operator*(const Vec3Lanes<F>& a, F s) {
  return {a.x * s, a.y * s, a.z * s};
}

FT_LANES_END

#endif  // toggled guard
