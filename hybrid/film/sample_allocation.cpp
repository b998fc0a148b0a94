#include "hybrid/film/sample_allocation.h"

#include <algorithm>
#include <cmath>

#include "core/platform/parallel.h"

namespace fieldtrace {
namespace {

// What a cell's samples may have missed: a sample as bright as half of the cells that are not black (root mean square
// of their pixels), once in so many times as many.
constexpr double k_unseen = 0.25;

// Cells get no more where that leaves so many times what is left if all get the most.
constexpr double k_all_but = 1.01;

struct CellSums {
  double pixels = 0.0, square = 0.0, work = 0.0, samples = 0.0;  // square: half_difference()
  double of_value = 0.0;                                         // square of the mean
  double of_quarters = 0.0, of_their_halves = 0.0;  // of pixels in quarters: these' and halves' differences

  void add(const CellSums& o) {
    pixels += o.pixels, square += o.square, work += o.work, samples += o.samples, of_value += o.of_value;
    of_quarters += o.of_quarters, of_their_halves += o.of_their_halves;
  }
  // The variance of one sample, if it fell by `decay` from half the samples to all, and falls by later_decay() of that.
  double variance(double decay) const {
    if (!(pixels > 0.0)) return 0.0;
    return square / pixels / (std::exp2(decay) - 1.0) * std::pow(samples / pixels, later_decay(decay));
  }
  // How the mean square falls from half the samples to all: that of pixels without quarters by `decay`.
  double decay_or(double decay, double most) const {
    if (!(square > 0.0)) return decay;
    double left = std::max(square - of_their_halves, 0.0) / (std::exp2(decay) - 1.0);
    left += noise_left(of_their_halves, of_quarters, most);
    return std::log2(1.0 + square / left);
  }
};

// The value that a pixel's error is relative to: the mean of its own and its diagonal neighbours', which are of its
// colour. Its own alone goes up and down with its noise: a bright sample that one half has would be an error of 1,
// however bright it is. Its neighbours' alone would make too much of a highlight amid dark ones.
DVec3 value_about(const FilmSums& film, int x, int y) {
  const Rect& w = film.window;
  const auto mean = [&](int i, int j) { return PixelSums(film.pixels[film.index(i, j)]).mean(); };
  DVec3 sum = mean(x, y);
  double count = 1.0;
  for (const int j : {y - 1, y + 1}) {
    for (const int i : {x - 1, x + 1}) {
      if (i < w.x || i >= w.x + w.width || j < w.y || j >= w.y + w.height) continue;
      sum += mean(i, j);
      ++count;
    }
  }
  return sum / count;
}

CellSums sums_of(const FilmSums& film, int x, int y, ErrorMeasure measure) {
  const PixelSums p = film.pixels[film.index(x, y)];
  const DVec3 value = measure == ErrorMeasure::relative ? value_about(film, x, y) : DVec3(0.0);
  const DVec3 mean = p.mean();
  CellSums s = {1.0, weighted_square(p.half_difference(), value, measure), p.work, double(p.samples()),
                weighted_square(mean * mean, value, measure)};
  if (!p.has_quarters()) return s;
  s.of_quarters = weighted_square(p.quarter_difference(), value, measure);
  s.of_their_halves = s.square;
  return s;
}

}  // namespace

double weighted_square(const DVec3& squares, const DVec3& value, ErrorMeasure measure) {
  if (measure == ErrorMeasure::absolute) return (squares.x + squares.y + squares.z) / 3.0;
  const DVec3 weighted = squares / (value * value + k_relative_floor);
  return (weighted.x + weighted.y + weighted.z) / 3.0;
}

NoiseCells::NoiseCells(const Rect& window) : window_(window) {
  const auto blocks_along = [](int n) { return size_t((n + k_noise_block - 1) / k_noise_block); };
  columns_ = blocks_along(window_.width);
  rows_ = blocks_along(window_.height);
}

SampleAllocation::SampleAllocation(const FilmSums& film, ErrorMeasure measure, double decay, double most) {
  const Rect& window = film.window;
  const NoiseCells cells(window);
  const size_t columns = cells.columns(), rows = cells.rows();
  std::vector<CellSums> sums(cells.count());
  parallel_for(rows, [&](size_t row) {
    const int top = window.y + int(row) * k_noise_block;
    for (int y = top; y < std::min(top + k_noise_block, window.y + window.height); ++y) {
      for (int x = window.x; x < window.x + window.width; ++x) {
        sums[cells.cell(x, y)].add(sums_of(film, x, y, measure));
      }
    }
  });
  CellSums colours[2];
  for (size_t i = 0; i < sums.size(); ++i) colours[i & 1].add(sums[i]);
  for (size_t colour = 0; colour < 2; ++colour) {
    const CellSums& shown = colours[1 - colour].pixels > 0.0 ? colours[1 - colour] : colours[colour];
    colour_decay_[colour] = shown.decay_or(std::min(decay, most), most);
  }
  pixels_ = double(film.pixels.size());
  // As the other colour shows it, too.
  const auto unseen_by = [&](size_t colour) {
    const size_t shown = colours[1 - colour].pixels > 0.0 ? 1 - colour : colour;
    std::vector<double> values;
    for (size_t i = shown; i < sums.size(); i += 2) {
      if (sums[i].of_value > 0.0) values.push_back(sums[i].of_value / sums[i].pixels);
    }
    if (values.empty()) return k_unseen;
    const auto middle = values.begin() + ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return k_unseen * *middle;
  };
  const double unseen[2] = {unseen_by(0), unseen_by(1)};
  // Each colour is planned by the other one's sums, and by how noise falls as these show it.
  std::vector<double> variances(sums.size());
  parallel_for(rows, [&](size_t row) {
    for (size_t i = 2 * row * columns; i < 2 * (row + 1) * columns; ++i)
      variances[i] = sums[i].variance(colour_decay_[1 - (i & 1)]);
  });
  cells_.resize(sums.size());
  for (size_t row = 0; row < rows; ++row) {
    for (size_t column = 0; column < columns; ++column) {
      for (size_t colour = 0; colour < 2; ++colour) {
        const size_t block = row * columns + column, mine = 2 * block + colour, others = 2 * block + 1 - colour;
        const double p = colour_decay_[colour], later = later_decay(p);
        const CellSums &own = sums[mine], &other = sums[others];
        const double variance = other.pixels > 0.0 ? variances[others] : own.variance(p);
        // Half of what is known comes from the blocks around: a block's own estimate is noisy.
        double around = 0.0, weight = 0.0;
        for (size_t r = row - std::min<size_t>(row, 1); r <= std::min(row + 1, rows - 1); ++r) {
          for (size_t c = column - std::min<size_t>(column, 1); c <= std::min(column + 1, columns - 1); ++c) {
            const size_t near = 2 * (r * columns + c) + 1 - colour;
            around += sums[near].pixels * variances[near];
            weight += sums[near].pixels;
          }
        }
        around = weight > 0.0 ? around / weight : variance;
        NoiseCell& cell = cells_[mine];
        cell.pixels = own.pixels;
        const CellSums& shown = other.samples > 0.0 ? other : own;
        const double of_whole_cell = 0.5 * k_noise_block * k_noise_block * shown.samples / std::max(shown.pixels, 1.0);
        cell.variance = 0.5 * (variance + around);
        if (of_whole_cell > 0.0) cell.unseen = unseen[colour] / of_whole_cell;
        cell.work = shown.samples > 0.0 ? shown.work / shown.samples : 1.0;
        cell.samples = own.pixels > 0.0 ? own.samples / own.pixels : 0.0;
        cell.mean_square = cell.samples > 0.0 ? variance * std::pow(cell.samples, -later) : 0.0;
        colour_pixels_[colour] += own.pixels;
        colour_mean_square_[colour] += own.pixels * cell.mean_square;
      }
    }
  }
  for (size_t colour = 0; colour < 2; ++colour) {
    mean_square_ += colour_mean_square_[colour] / std::max(pixels_, 1.0);
    colour_mean_square_[colour] /= std::max(colour_pixels_[colour], 1.0);
  }
  colours[0].add(colours[1]);
  decay_ = colours[0].decay_or(std::min(decay, most), most);
}

double SampleAllocation::mean_samples() const {
  double sum = 0.0;
  for (const NoiseCell& c : cells_) sum += c.pixels * c.samples;
  return sum / std::max(pixels_, 1.0);
}

uint32_t SampleAllocation::fewest_samples() const {
  double least = k_infinity;
  for (const NoiseCell& c : cells_) {
    if (c.pixels > 0.0) least = std::min(least, c.samples);
  }
  return least < k_infinity ? uint32_t(least) : 0;
}

uint32_t SampleAllocation::most_samples() const {
  double most = 0.0;
  for (const NoiseCell& c : cells_) most = std::max(most, c.samples);
  return uint32_t(most);
}

double SampleAllocation::work() const {
  double sum = 0.0;
  for (const NoiseCell& c : cells_) sum += c.pixels * c.samples * c.work;
  return sum;
}

SampleAllocation::Shares SampleAllocation::shares(const Limits& limits) const {
  Shares shares = {{}, {}};
  for (size_t i = 0; i < cells_.size(); ++i) {
    const NoiseCell& c = cells_[i];
    const double decay = later_decay(colour_decay_[i & 1]);
    const double most = std::min(c.samples * limits.growth, limits.most);
    Shares::Cell cell;
    // A target ends by what is seen, and would end no later.
    cell.variance = limits.mean_square > 0.0 ? c.variance : std::max(c.variance, c.unseen);
    cell.wanted = std::log2(cell.variance / c.work) / (decay + 1.0);
    if (c.pixels > 0.0 && c.samples > 0.0) {
      cell.least = int(std::floor(std::log2(c.samples)));
      cell.most = std::max(int(std::floor(std::log2(std::min(most, 0x1p31)))), cell.least);
    }
    shares.cells.push_back(cell);
  }
  for (size_t colour = 0; colour < 2; ++colour) {
    for (int i = 0; i < k_powers; ++i) shares.left[colour][i] = std::exp2(-later_decay(colour_decay_[colour]) * i);
  }
  return shares;
}

int SampleAllocation::goal(const Shares::Cell& cell, double scale) {
  return int(std::clamp(std::nearbyint(scale + cell.wanted), double(cell.least), double(cell.most)));
}

SampleAllocation::Outlook SampleAllocation::outlook(size_t colour, double scale, const Shares& shares) const {
  Outlook all;
  for (size_t i = colour; i < cells_.size(); i += 2) {
    const NoiseCell& c = cells_[i];
    if (!(c.samples > 0.0)) continue;
    const int power = goal(shares.cells[i], scale);
    all.mean_square += c.pixels * shares.cells[i].variance * shares.left[colour][power];
    all.work += c.pixels * c.work * (double(1u << power) - c.samples);
  }
  all.mean_square /= std::max(colour_pixels_[colour], 1.0);
  return all;
}

double SampleAllocation::scale_of(size_t colour, double mean_square, double work, const Shares& shares) const {
  // Both sides of the search are far beyond any goal.
  double low = -1100.0, high = 1100.0;
  // Where noisy cells have all that they may get, others would gain nothing to speak of.
  mean_square = std::max(mean_square, k_all_but * outlook(colour, high, shares).mean_square);
  while (high - low > 1e-4) {
    const double middle = 0.5 * (low + high);
    const Outlook expected = outlook(colour, middle, shares);
    (expected.mean_square < mean_square || expected.work > work ? high : low) = middle;
  }
  return high;
}

std::vector<uint32_t> SampleAllocation::further(const Limits& limits) const {
  std::vector<uint32_t> counts(cells_.size(), 0);
  const Shares wanted = shares(limits);
  for (size_t colour = 0; colour < 2; ++colour) {
    const double now = colour_mean_square_[colour];
    if (limits.mean_square > 0.0 && !(now > limits.mean_square)) continue;
    // Blocks' variances that are mixed with those around are not quite what they are by themselves.
    const double target =
        limits.mean_square > 0.0 ? limits.mean_square * outlook(colour, -k_infinity, wanted).mean_square / now : 0.0;
    const double share = pixels_ > 0.0 ? colour_pixels_[colour] / pixels_ : 0.0;
    const double scale = scale_of(colour, target, share * limits.work, wanted);
    for (size_t i = colour; i < cells_.size(); i += 2) {
      const NoiseCell& c = cells_[i];
      if (!(c.samples > 0.0)) continue;
      counts[i] = (1u << goal(wanted.cells[i], scale)) - uint32_t(c.samples);
    }
  }
  return counts;
}

double SampleAllocation::work_of(const std::vector<uint32_t>& further) const {
  double sum = 0.0;
  for (size_t i = 0; i < cells_.size(); ++i) sum += cells_[i].pixels * cells_[i].work * double(further[i]);
  return sum;
}

}  // namespace fieldtrace
