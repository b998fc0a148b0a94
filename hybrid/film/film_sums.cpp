#include "hybrid/film/film_sums.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/math/finite.h"

namespace fieldtrace {
namespace {

float* put(float* out, const DVec3& v) {
  for (int c = 0; c < 3; ++c) *out++ = float(v[c]);
  return out;
}

}  // namespace

uint64_t PixelSums::add(int quarter, std::span<const Rgb> samples, double work_of_one, double seconds_of_one) {
  uint64_t not_finite = 0;
  DVec3 sum = radiance[quarter], of_squares = squares;
  for (const Rgb& r : samples) {
    sum += DVec3(r);
    of_squares += DVec3(r) * DVec3(r);
  }
  if (!std::isfinite(sum.x + sum.y + sum.z)) {  // never by overflow: the samples are floats
    sum = radiance[quarter], of_squares = squares;
    for (const Rgb& r : samples) {
      if (is_finite(r)) {
        sum += DVec3(r);
        of_squares += DVec3(r) * DVec3(r);
      } else {
        ++not_finite;
      }
    }
  }
  radiance[quarter] = sum;
  squares = of_squares;
  count[quarter / 2] += uint32_t(samples.size());
  work += float(double(samples.size()) * work_of_one);
  seconds += double(samples.size()) * seconds_of_one;
  return not_finite;
}

uint64_t PixelSums::add_of(uint32_t first, uint32_t total, std::span<const Rgb> samples, double work_of_one,
                           double seconds_of_one) {
  uint64_t not_finite = 0;
  while (!samples.empty()) {
    const uint64_t quarter = uint64_t(first) * 4 / total, end = ((quarter + 1) * total + 3) / 4;
    const size_t n = std::min(samples.size(), size_t(end - first));
    not_finite += add(int(quarter), samples.first(n), work_of_one, seconds_of_one);
    samples = samples.subspan(n);
    first += uint32_t(n);
  }
  return not_finite;
}

void PixelSums::append(const PixelSums& later) {
  if (has_halves() && later.samples() > 0) {
    const bool is_quarter = later.samples() > samples();
    const DVec3 halves[2] = {sum_of(0), sum_of(1)};
    radiance[0] = is_quarter ? halves[0] + halves[1] : halves[0];
    radiance[1] = is_quarter ? DVec3(0.0) : halves[1];
    radiance[2] = radiance[3] = DVec3(0.0);
    count[0] = samples();
    count[1] = 0;
  }
  merge(later);
}

void PixelSums::merge(const PixelSums& other) {
  for (int quarter = 0; quarter < 4; ++quarter) radiance[quarter] += other.radiance[quarter];
  for (int half = 0; half < 2; ++half) count[half] += other.count[half];
  squares += other.squares;
  work += other.work;
  seconds += other.seconds;
}

DVec3 PixelSums::variance(double decay) const {
  if (has_halves()) return half_difference() / (std::exp2(decay) - 1.0);
  const double n = double(samples());
  if (n < 2.0) return DVec3(0.0);
  const DVec3 m = mean();
  return glm::max(squares / n - m * m, DVec3(0.0)) / (n - 1.0);
}

static_assert(sizeof(StoredSums) == 64 && sizeof(DVec3) == 6 * sizeof(float));

StoredSums::StoredSums(const PixelSums& sums)
    : values_{}, count_{sums.count[0], sums.count[1]}, work_(sums.work), seconds_(float(sums.seconds)) {
  if (sums.has_halves()) {
    for (int i = 0; i < 12; ++i) values_[i] = float(sums.radiance[i / 3][i % 3]);
  } else {
    std::memcpy(values_, &sums.radiance[0], sizeof(DVec3));
    std::memcpy(values_ + 6, &sums.squares, sizeof(DVec3));
  }
}

FilmSums::FilmSums(const Rect& w, bool has_layers) : window(w) {
  pixels.resize(size_t(w.width) * size_t(w.height));
  if (has_layers) aovs.resize(pixels.size());
}

float* write_pixel(const PixelSums& sums, const AovSums& aovs, const std::vector<Aov>& layers, double decay,
                   float* out) {
  out = put(out, sums.mean());
  for (const Aov layer : layers) {
    switch (layer) {
      case Aov::samples:
        *out++ = float(sums.samples());
        break;
      case Aov::variance:
        out = put(out, sums.variance(decay));
        break;
      case Aov::time:
        *out++ = float(sums.seconds * 1e9);
        break;
      default:
        out = aovs.write(layer, out);
    }
  }
  return out;
}

}  // namespace fieldtrace
