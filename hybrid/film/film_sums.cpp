#include "hybrid/film/film_sums.h"

#include <cmath>

#include "core/math/finite.h"

namespace fieldtrace {
namespace {

float* put(float* out, const DVec3& v) {
  for (int c = 0; c < 3; ++c) *out++ = float(v[c]);
  return out;
}

}  // namespace

uint64_t PixelSums::add(int half, std::span<const Rgb> samples, double work_of_one, double seconds_of_one) {
  uint64_t not_finite = 0;
  DVec3 sum = radiance[half], of_squares = squares;
  for (const Rgb& r : samples) {
    sum += DVec3(r);
    of_squares += DVec3(r) * DVec3(r);
  }
  if (!std::isfinite(sum.x + sum.y + sum.z)) {  // never by overflow: the samples are floats
    sum = radiance[half], of_squares = squares;
    for (const Rgb& r : samples) {
      if (is_finite(r)) {
        sum += DVec3(r);
        of_squares += DVec3(r) * DVec3(r);
      } else {
        ++not_finite;
      }
    }
  }
  radiance[half] = sum;
  squares = of_squares;
  count[half] += uint32_t(samples.size());
  work += float(double(samples.size()) * work_of_one);
  seconds += double(samples.size()) * seconds_of_one;
  return not_finite;
}

void PixelSums::merge(const PixelSums& other) {
  for (int half = 0; half < 2; ++half) {
    radiance[half] += other.radiance[half];
    count[half] += other.count[half];
  }
  squares += other.squares;
  work += other.work;
  seconds += other.seconds;
}

DVec3 PixelSums::variance() const {
  if (count[0] > 0 && count[1] > 0) {
    const DVec3 half = 0.5 * (mean_of(0) - mean_of(1));
    return half * half;
  }
  const double n = double(samples());
  if (n < 2.0) return DVec3(0.0);
  const DVec3 m = mean();
  return glm::max(squares / n - m * m, DVec3(0.0)) / (n - 1.0);
}

FilmSums::FilmSums(const Rect& w, bool has_layers) : window(w) {
  pixels.resize(size_t(w.width) * size_t(w.height));
  if (has_layers) aovs.resize(pixels.size());
}

float* write_pixel(const PixelSums& sums, const AovSums& aovs, const std::vector<Aov>& layers, float* out) {
  out = put(out, sums.mean());
  for (const Aov layer : layers) {
    switch (layer) {
      case Aov::samples:
        *out++ = float(sums.samples());
        break;
      case Aov::variance:
        out = put(out, sums.variance());
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
