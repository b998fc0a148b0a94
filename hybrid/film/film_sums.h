// What the camera samples of a picture add up to, pixel by pixel.
//
// A pixel's samples are one sequence. Where a picture's error is estimated it is kept in quarters, one after the other,
// and has a power of two of samples, two or more unless one will do: halves and quarters of such a sequence are as well
// distributed as the whole, and how much they differ tells the variance of the mean. Other pictures have the first
// quarter alone.
// Thread-safety: values; a pixel belongs to one thread at a time.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/platform/zeroed_vector.h"
#include "core/scene/scene.h"
#include "hybrid/path/aovs.h"

namespace fieldtrace {

struct PixelSums {
  DVec3 radiance[4] = {DVec3(0.0), DVec3(0.0), DVec3(0.0),
                       DVec3(0.0)};  // by quarter; of two samples, the first and third
  DVec3 squares = DVec3(0.0);        // of all samples
  uint32_t count[2] = {0, 0};        // of samples, by half
  float work = 0.0f;                 // camera samples and the rays that they took
  double seconds = 0.0;              // that they took one thread

  // Adds samples in their order; those that are not finite count as black. Returns how many these are. `work` and
  // `seconds` are those of one sample.
  uint64_t add(int quarter, std::span<const Rgb> samples, double work = 0.0, double seconds = 0.0);
  // The same of a sequence that is to have `total` samples, from `first` on.
  uint64_t add_of(uint32_t first, uint32_t total, std::span<const Rgb> samples, double work, double seconds);
  // Adds, quarter by quarter.
  void merge(const PixelSums& other);
  // Adds samples that go on where these end, in quarters of what both are then; if there are samples, by quarters, then
  // at least as many.
  void append(const PixelSums& later);

  uint32_t samples() const { return count[0] + count[1]; }
  DVec3 sum_of(int half) const { return radiance[2 * half] + radiance[2 * half + 1]; }
  DVec3 mean() const { return samples() ? (sum_of(0) + sum_of(1)) / double(samples()) : DVec3(0.0); }
  bool has_halves() const { return count[1] > 0; }
  bool has_quarters() const { return count[0] > 1 && has_halves(); }
  // The square of half the halves' difference, by channel, a random number with one degree of freedom: in the mean what
  // the variance of the mean has fallen by from half the samples to all, and itself where halves are independent. 0
  // for one sample.
  DVec3 half_difference() const;
  // The same of the quarters of each half, mean of both: what it fell by from a quarter to half of the samples.
  DVec3 quarter_difference() const;
  // The variance of mean(), by channel, where it falls as samples^-decay; of samples that are not in halves, that of
  // independent samples, which stratified ones fall below. 0 for less than two samples.
  DVec3 variance(double decay = 1.0) const;
};

// A pixel's samples of two sequences that are independent of each other, each in quarters.
using SequencePair = std::array<PixelSums, 2>;

// PixelSums as a film keeps them, in little memory: what a film first writes to is a good part of a short frame. Halves
// and quarters are rounded to floats; sums in one piece are not, so that checkpoints change no picture.
class StoredSums {
 public:
  StoredSums() = default;
  StoredSums(const PixelSums& sums);
  operator PixelSums() const;
  uint32_t samples() const { return count_[0] + count_[1]; }
  double work() const { return work_; }
  bool has_halves() const { return count_[1] > 0; }
  bool has_quarters() const { return count_[0] > 1 && has_halves(); }
  // As PixelSums have them: reading these alone spares the conversion.
  DVec3 mean() const;
  DVec3 half_difference() const;
  DVec3 quarter_difference() const;  // 0 without quarters

 private:
  DVec3 quarter(int i) const { return {values_[3 * i], values_[3 * i + 1], values_[3 * i + 2]}; }
  DVec3 whole() const {
    DVec3 sum;
    std::memcpy(&sum, values_, sizeof(DVec3));
    return sum;
  }

  alignas(8) float values_[12];  // radiance by quarter; or six doubles, the first one and squares
  uint32_t count_[2];
  float work_, seconds_;
};

// half_difference() of halves with these sums and numbers of samples.
inline DVec3 difference_of_halves(const DVec3& first, uint32_t of_first, const DVec3& second, uint32_t of_second) {
  if (of_first == 0 || of_second == 0) return DVec3(0.0);
  const DVec3 half = 0.5 / double(of_first) * first - 0.5 / double(of_second) * second;
  return half * half;
}

// quarter_difference() of quarters with these sums, of halves of so many samples.
inline DVec3 difference_of_quarters(const DVec3& a, const DVec3& b, const DVec3& c, const DVec3& d, uint32_t of_half) {
  const double scale = 1.0 / double(of_half);
  const DVec3 first = scale * (a - b), second = scale * (c - d);
  return 0.5 * (first * first + second * second);
}

inline DVec3 PixelSums::half_difference() const {
  return difference_of_halves(sum_of(0), count[0], sum_of(1), count[1]);
}

inline DVec3 PixelSums::quarter_difference() const {
  return difference_of_quarters(radiance[0], radiance[1], radiance[2], radiance[3], count[0]);
}

inline DVec3 StoredSums::mean() const {
  const DVec3 sum = has_halves() ? (quarter(0) + quarter(1)) + (quarter(2) + quarter(3)) : whole();
  return samples() > 0 ? sum / double(samples()) : DVec3(0.0);
}

inline DVec3 StoredSums::half_difference() const {
  if (!has_halves()) return DVec3(0.0);
  return difference_of_halves(quarter(0) + quarter(1), count_[0], quarter(2) + quarter(3), count_[1]);
}

inline DVec3 StoredSums::quarter_difference() const {
  if (!has_quarters()) return DVec3(0.0);
  return difference_of_quarters(quarter(0), quarter(1), quarter(2), quarter(3), count_[0]);
}

inline StoredSums::operator PixelSums() const {
  PixelSums sums;
  sums.count[0] = count_[0];
  sums.count[1] = count_[1];
  sums.work = work_;
  sums.seconds = seconds_;
  if (sums.has_halves()) {
    for (int i = 0; i < 12; ++i) sums.radiance[i / 3][i % 3] = values_[i];
  } else {
    std::memcpy(&sums.radiance[0], values_, sizeof(DVec3));
    std::memcpy(&sums.squares, values_ + 6, sizeof(DVec3));
  }
  return sums;
}

// The sums of a window's pixels, row by row.
struct FilmSums {
  Rect window;
  ZeroedVector<StoredSums> pixels;
  ZeroedVector<AovSums> aovs;  // empty unless layers are asked for

  FilmSums() = default;
  FilmSums(const Rect& window, bool has_layers);

  size_t index(int x, int y) const { return size_t(y - window.y) * size_t(window.width) + size_t(x - window.x); }
};

// Writes a pixel: R, G, B and the channels of `layers`. `decay` as for PixelSums::variance(). Returns the end of the
// output.
float* write_pixel(const PixelSums& sums, const AovSums& aovs, const std::vector<Aov>& layers, double decay,
                   float* out);

}  // namespace fieldtrace
