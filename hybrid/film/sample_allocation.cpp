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

// The variance of one sample, if it fell by `decay` from half the samples to all, and falls by later_decay() of that.
double variance_of_one(const NoiseCellSums& s, double decay) {
  if (!(s.pixels > 0.0)) return 0.0;
  return s.square / s.pixels / (std::exp2(decay) - 1.0) * std::pow(s.samples / s.pixels, later_decay(decay));
}

// How the mean square falls from half the samples to all: that of pixels without quarters by `decay`.
double decay_of(const NoiseCellSums& s, double decay, double most) {
  if (!(s.square > 0.0)) return decay;
  double left = std::max(s.square - s.of_their_halves, 0.0) / (std::exp2(decay) - 1.0);
  left += noise_left(s.of_their_halves, s.of_quarters, most);
  return std::log2(1.0 + s.square / left);
}

}  // namespace

SampleAllocation::SampleAllocation(const NoiseSums& sums, double decay, double most) {
  const size_t columns = sums.cells().columns(), rows = sums.cells().rows(), count = sums.cells().count();
  NoiseCellSums colours[2];
  for (size_t i = 0; i < count; ++i) colours[i & 1].add(sums[i]);
  for (size_t colour = 0; colour < 2; ++colour) {
    const NoiseCellSums& shown = colours[1 - colour].pixels > 0.0 ? colours[1 - colour] : colours[colour];
    colour_decay_[colour] = decay_of(shown, std::min(decay, most), most);
  }
  pixels_ = colours[0].pixels + colours[1].pixels;
  // As the other colour shows it, too.
  const auto unseen_by = [&](size_t colour) {
    const size_t shown = colours[1 - colour].pixels > 0.0 ? 1 - colour : colour;
    std::vector<double> values;
    for (size_t i = shown; i < count; i += 2) {
      if (sums[i].of_value > 0.0) values.push_back(sums[i].of_value / sums[i].pixels);
    }
    if (values.empty()) return k_unseen;
    const auto middle = values.begin() + ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return k_unseen * *middle;
  };
  const double unseen[2] = {unseen_by(0), unseen_by(1)};
  // Each colour is planned by the other one's sums, and by how noise falls as these show it.
  std::vector<double> variances(count);
  parallel_for(rows, [&](size_t row) {
    for (size_t i = 2 * row * columns; i < 2 * (row + 1) * columns; ++i)
      variances[i] = variance_of_one(sums[i], colour_decay_[1 - (i & 1)]);
  });
  cells_.resize(count);
  for (size_t row = 0; row < rows; ++row) {
    for (size_t column = 0; column < columns; ++column) {
      for (size_t colour = 0; colour < 2; ++colour) {
        const size_t block = row * columns + column, mine = 2 * block + colour, others = 2 * block + 1 - colour;
        const double p = colour_decay_[colour], later = later_decay(p);
        const NoiseCellSums &own = sums[mine], &other = sums[others];
        const double variance = other.pixels > 0.0 ? variances[others] : variance_of_one(own, p);
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
        const NoiseCellSums& shown = other.samples > 0.0 ? other : own;
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
  decay_ = decay_of(colours[0], std::min(decay, most), most);
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
