// How much the halves and quarters of a film's pixels differ, summed over cells: half the pixels of a block of 8 x 8,
// like the fields of one colour of a chessboard. What a picture's noise is told from (sample_allocation.h).
//
// A tile's cells are summed as soon as the tile is traced, while its pixels lie in a cache: all of a film's, read once
// more after each round, took a tenth of a short frame.
// Thread-safety: threads may sum different cells at once.
#pragma once

#include <cstdint>
#include <vector>

#include "hybrid/film/film_sums.h"

namespace fieldtrace {

// Pixels along each side of a block.
inline constexpr int k_noise_block = 8;

// Added to the denominators of relative metrics, so that black pixels count without dominating.
inline constexpr double k_relative_floor = 1e-2;

// What an error is measured by: the root of the mean square over pixels and channels of the difference (absolute), or
// of the difference over sqrt(value^2 + k_relative_floor) (relative; the square is the metric relmse).
enum class ErrorMeasure { absolute, relative };

// The mean over channels of squares, by the measure, where the picture's value is `value`.
double weighted_square(const DVec3& squares, const DVec3& value, ErrorMeasure measure);

// How a window's pixels fall into cells, two for each block.
class NoiseCells {
 public:
  explicit NoiseCells(const Rect& window);
  size_t cell(int x, int y) const {
    const auto column = size_t((x - window_.x) / k_noise_block), row = size_t((y - window_.y) / k_noise_block);
    return 2 * (row * columns_ + column) + size_t((x ^ y) & 1);
  }
  size_t columns() const { return columns_; }
  size_t rows() const { return rows_; }
  size_t count() const { return 2 * columns_ * rows_; }

 private:
  Rect window_;
  size_t columns_ = 0, rows_ = 0;
};

// Sums over the pixels of a cell, or of several. Squares are means over channels, by the measure.
struct NoiseCellSums {
  double pixels = 0.0, work = 0.0, samples = 0.0;
  double square = 0.0;    // PixelSums::half_difference()
  double of_value = 0.0;  // square of the mean
  // Of pixels in quarters: PixelSums::quarter_difference(), and their half_difference().
  double of_quarters = 0.0, of_their_halves = 0.0;

  void add(const NoiseCellSums& other);
};

class NoiseSums {
 public:
  // Of a film without samples.
  NoiseSums(const Rect& window, ErrorMeasure measure);

  // Sums the cells of a tile, or of the whole film, anew. Unchecked: the tile is made of whole blocks, but at the
  // window's end, and the film has the window.
  void sum(const FilmSums& film, const Rect& tile);
  void sum(const FilmSums& film);

  const Rect& window() const { return window_; }
  const NoiseCells& cells() const { return cells_; }
  const NoiseCellSums& operator[](size_t cell) const { return sums_[cell]; }

 private:
  void sum_block(const FilmSums& film, const Rect& block);

  Rect window_;
  NoiseCells cells_;
  ErrorMeasure measure_;
  std::vector<NoiseCellSums> sums_;
};

}  // namespace fieldtrace
