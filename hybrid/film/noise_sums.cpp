#include "hybrid/film/noise_sums.h"

#include <algorithm>

#include "core/platform/parallel.h"
#include "hybrid/path/tiles.h"

namespace fieldtrace {
namespace {

// The value that a pixel's error is relative to: the mean of its own and its diagonal neighbours' in the block, which
// are of its cell. Its own alone goes up and down with its noise: a bright sample that one half has would be an error
// of 1, however bright it is. Its neighbours' alone would make too much of a highlight amid dark ones.
DVec3 value_about(const FilmSums& film, const Rect& block, int x, int y) {
  const auto mean = [&](int i, int j) { return film.pixels[film.index(i, j)].mean(); };
  DVec3 sum = mean(x, y);
  double count = 1.0;
  for (const int j : {y - 1, y + 1}) {
    for (const int i : {x - 1, x + 1}) {
      if (!contains(block, {i, j})) continue;
      sum += mean(i, j);
      ++count;
    }
  }
  return sum / count;
}

NoiseCellSums sums_of(const FilmSums& film, const Rect& block, int x, int y, ErrorMeasure measure) {
  const StoredSums& p = film.pixels[film.index(x, y)];
  const DVec3 value = measure == ErrorMeasure::relative ? value_about(film, block, x, y) : DVec3(0.0);
  const DVec3 mean = p.mean();
  NoiseCellSums s;
  s.pixels = 1.0;
  s.work = p.work();
  s.samples = double(p.samples());
  s.square = weighted_square(p.half_difference(), value, measure);
  s.of_value = weighted_square(mean * mean, value, measure);
  if (!p.has_quarters()) return s;
  s.of_quarters = weighted_square(p.quarter_difference(), value, measure);
  s.of_their_halves = s.square;
  return s;
}

// The cell of a block's even pixels; that of the others follows.
size_t first_cell(const NoiseCells& cells, const Rect& block) { return cells.cell(block.x, block.y) & ~size_t(1); }

}  // namespace

double weighted_square(const DVec3& squares, const DVec3& value, ErrorMeasure measure) {
  if (measure == ErrorMeasure::absolute) return (squares.x + squares.y + squares.z) / 3.0;
  const DVec3 weighted = squares / (value * value + k_relative_floor);
  return (weighted.x + weighted.y + weighted.z) / 3.0;
}

NoiseCells::NoiseCells(const Rect& window) : window_(window) {
  const auto blocks_along = [](int n) { return size_t((n + k_noise_block - 1) / k_noise_block); };
  columns_ = blocks_along(window.width);
  rows_ = blocks_along(window.height);
}

void NoiseCellSums::add(const NoiseCellSums& other) {
  pixels += other.pixels, work += other.work, samples += other.samples;
  square += other.square, of_value += other.of_value;
  of_quarters += other.of_quarters, of_their_halves += other.of_their_halves;
}

NoiseSums::NoiseSums(const Rect& window, ErrorMeasure measure)
    : window_(window), cells_(window), measure_(measure), sums_(cells_.count()) {
  for (const Rect& block : make_tiles(window, k_noise_block)) {
    const size_t even = first_cell(cells_, block);
    const int pixels = block.width * block.height, begins_odd = (block.x ^ block.y) & 1;
    sums_[even].pixels = double((pixels + 1 - begins_odd) / 2);
    sums_[even + 1].pixels = double((pixels + begins_odd) / 2);
  }
}

void NoiseSums::sum_block(const FilmSums& film, const Rect& block) {
  NoiseCellSums colours[2];
  for (int y = block.y; y < block.y + block.height; ++y) {
    for (int x = block.x; x < block.x + block.width; ++x)
      colours[(x ^ y) & 1].add(sums_of(film, block, x, y, measure_));
  }
  const size_t even = first_cell(cells_, block);
  sums_[even] = colours[0], sums_[even + 1] = colours[1];
}

void NoiseSums::sum(const FilmSums& film, const Rect& tile) {
  for (const Rect& block : make_tiles(tile, k_noise_block)) sum_block(film, block);
}

void NoiseSums::sum(const FilmSums& film) {
  parallel_for(cells_.rows(), [&](size_t row) {
    const int top = window_.y + int(row) * k_noise_block;
    sum(film, {window_.x, top, window_.width, std::min(k_noise_block, window_.y + window_.height - top)});
  });
}

}  // namespace fieldtrace
