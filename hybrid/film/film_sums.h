// What the camera samples of a picture add up to, pixel by pixel.
//
// Samples of pictures whose error is estimated come in two halves, drawn independently of each other: half their
// difference has the variance of the pixel's mean. Other pictures have the first half alone. Thread-safety: values; a
// pixel belongs to one thread at a time.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"
#include "hybrid/path/aovs.h"

namespace fieldtrace {

struct PixelSums {
  DVec3 radiance[2] = {DVec3(0.0), DVec3(0.0)};  // by half
  DVec3 squares = DVec3(0.0);                    // of both halves' samples
  uint32_t count[2] = {0, 0};
  float work = 0.0f;     // camera samples and the rays that they took
  double seconds = 0.0;  // that they took one thread

  // Adds samples in their order; those that are not finite count as black. Returns how many these are. `work` and
  // `seconds` are those of one sample.
  uint64_t add(int half, std::span<const Rgb> samples, double work = 0.0, double seconds = 0.0);
  void merge(const PixelSums& other);

  uint32_t samples() const { return count[0] + count[1]; }
  DVec3 mean_of(int half) const { return count[half] > 0 ? radiance[half] / double(count[half]) : DVec3(0.0); }
  DVec3 mean() const { return samples() ? (radiance[0] + radiance[1]) / double(samples()) : DVec3(0.0); }
  // The variance of mean(), by channel: of two halves, which must be alike in size, that of their difference, a random
  // number with one degree of freedom; of one, that of independent samples, which stratified ones fall below. 0 for
  // less than two samples.
  DVec3 variance() const;
};

// The sums of a window's pixels, row by row.
struct FilmSums {
  Rect window;
  std::vector<PixelSums> pixels;
  std::vector<AovSums> aovs;  // empty unless layers are asked for

  FilmSums() = default;
  FilmSums(const Rect& window, bool has_layers);

  size_t index(int x, int y) const { return size_t(y - window.y) * size_t(window.width) + size_t(x - window.x); }
};

// Writes a pixel: R, G, B and the channels of `layers`. Returns the end of the output.
float* write_pixel(const PixelSums& sums, const AovSums& aovs, const std::vector<Aov>& layers, float* out);

}  // namespace fieldtrace
