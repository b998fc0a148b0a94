// The error that a picture's noise makes, and where further camera samples lower it most.
//
// A picture's mean square error falls fastest for its cost if each pixel gets samples in proportion to
// sqrt(variance / cost) of one of them (Neyman, "On the two different aspects of the representative method", 1934);
// where it falls as n^-p, in proportion to the (p + 1)st root of what p = 1 takes the square root of. That is rounded
// to a power of two, since a sequence is well distributed where it has one, and hardly better than half of it before.
// Variances are those of blocks of pixels, from the differences of their halves. So that no pixel's mean depends on why
// its sampling went on or ended, the pixels of a block take turns like the fields of a chessboard: each colour is
// planned by itself, from what the other one shows, and ends when that says so. (A bright sample that asked for more
// samples of its own pixel would be averaged away, a missing one would not be made up for.)
// Halves differ by V(n / 2) - V(n), if n samples leave the variance V(n); where that falls as n^-p, by (2^p - 1) V(n).
// The quarters tell p: they differ by 2^p times as much (Aitken, "On Bernoulli's numerical solution of algebraic
// equations", 1926: the limit of a geometric sequence from three of its members), or by more (noise_left()).
// Thread-safety: values.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/math.h"
#include "hybrid/film/noise_forecast.h"
#include "hybrid/film/noise_sums.h"

namespace fieldtrace {

// One colour of one block. Pixels of the same cell always have the same number of samples.
struct NoiseCell {
  double pixels = 0.0;
  // As the other colour of the block shows it, mean over pixels and channels: the mean square error now; and that of
  // one sample if it falls as it does, half of it from the blocks around.
  double mean_square = 0.0, variance = 0.0;
  double unseen = 0.0;   // of one sample: what all may have missed
  double work = 1.0;     // of a sample
  double samples = 0.0;  // of each pixel
};

class SampleAllocation {
 public:
  // `sums`: of a film whose samples are in quarters, or halves at least; `decay` is used where it has no quarters.
  // `most`: as most_decay() says.
  SampleAllocation(const NoiseSums& sums, double decay, double most = k_smooth_decay);

  // The mean square error that noise makes, by the measure, as the colours show it of each other.
  double mean_square() const { return mean_square_; }
  // From half the samples to all the mean square fell as samples^-decay: 1 for random samples, more for stratified
  // ones.
  double decay() const { return decay_; }
  // The mean number of samples of a pixel, and the least and the most.
  double mean_samples() const;
  uint32_t fewest_samples() const;
  uint32_t most_samples() const;
  // The work that all samples took.
  double work() const;

  const std::vector<NoiseCell>& cells() const { return cells_; }

  // What a round may add.
  struct Limits {
    double mean_square = 0.0;    // stop where the noise is expected to be this
    double work = k_infinity;    // of all further samples, at most
    double growth = k_infinity;  // no pixel gets more than this many times the samples that it has
    double most = k_infinity;    // samples of a pixel, in all
  };
  // Further samples of each pixel, by cell: with those that it has a power of two. All 0 only where the limits allow
  // none.
  std::vector<uint32_t> further(const Limits& limits) const;
  // The work of such samples.
  double work_of(const std::vector<uint32_t>& further) const;

 private:
  // Powers of two of samples.
  static constexpr int k_powers = 32;

  // In what proportion cells want samples. Numbers of samples are logarithms to the base 2.
  struct Shares {
    struct Cell {
      double variance = 0.0;    // that counts
      double wanted = 0.0;      // beside others
      int least = 0, most = 0;  // what it has, and may have
    };
    std::vector<Cell> cells;
    double left[2][k_powers];  // of the mean square of one sample, by colour
  };
  Shares shares(const Limits& limits) const;
  // The goal for a cell's samples where `scale` is added to what is wanted.
  static int goal(const Shares::Cell& cell, double scale);
  // Of the pixels of one colour: the mean square that is expected, and the work until then.
  struct Outlook {
    double mean_square = 0.0, work = 0.0;
  };
  Outlook outlook(size_t colour, double scale, const Shares& shares) const;
  // The scale at which a colour's noise or work is what is given.
  double scale_of(size_t colour, double mean_square, double work, const Shares& shares) const;

  std::vector<NoiseCell> cells_;
  double pixels_ = 0.0, mean_square_ = 0.0, decay_ = 1.0;
  double colour_pixels_[2] = {0.0, 0.0}, colour_mean_square_[2] = {0.0, 0.0};
  double colour_decay_[2] = {1.0, 1.0};  // as the other colour shows it
};

}  // namespace fieldtrace
