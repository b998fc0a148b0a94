// Seeded random numbers, directions and points for property tests.
//
// Thread-safety: one generator per thread.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>

#include "core/math/math.h"

namespace fieldtrace {

class TestRandom {
 public:
  explicit TestRandom(uint32_t seed) : engine_(seed) {}

  // [0, 1), 24 bits, the same on every standard library.
  float uniform() { return float(engine_() >> 8) * 0x1p-24f; }
  float uniform(float low, float high) { return low + (high - low) * uniform(); }
  float log_uniform(float low, float high) { return low * std::pow(high / low, uniform()); }
  uint32_t index(uint32_t n) { return uint32_t((uint64_t(engine_()) * n) >> 32); }

  // Uniform on the sphere, rounded to float from double.
  Vec3 direction() {
    const double z = 1.0 - 2.0 * double(uniform()), phi = 2.0 * 3.14159265358979323846 * double(uniform());
    const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
    return Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z));
  }
  // Uniform in the unit ball.
  Vec3 in_ball() { return direction() * std::cbrt(uniform()); }

 private:
  std::mt19937 engine_;
};

}  // namespace fieldtrace
