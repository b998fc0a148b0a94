#include "tests/support/image_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace::test {
namespace {

// Stored means are rounded to 16 bits, which errs by 2^-17 of them; and a picture's floats, sums of up to 128 samples,
// by 128 times 2^-24.
constexpr double k_rounding = 0x1p-16;

float round_bits(double value, int bits) {
  int exponent = 0;
  const double mantissa = std::frexp(value, &exponent);
  return float(std::ldexp(std::nearbyint(std::ldexp(mantissa, bits)), exponent - bits));
}

// Means over blocks of `size` x `size` pixels; those at the edges may be smaller. Three channels.
Image block_means(const Image& image, int size) {
  const int columns = (image.width + size - 1) / size, rows = (image.height + size - 1) / size;
  Image out{columns, rows, {"R", "G", "B"}, std::vector<float>(size_t(columns) * rows * 3)};
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      double sum[3] = {};
      int pixels = 0;
      for (int y = row * size; y < std::min((row + 1) * size, image.height); ++y) {
        for (int x = column * size; x < std::min((column + 1) * size, image.width); ++x, ++pixels) {
          for (int c = 0; c < 3; ++c) sum[c] += image.pixel(x, y)[c];
        }
      }
      for (int c = 0; c < 3; ++c) out.pixel(column, row)[c] = float(sum[c] / pixels);
    }
  }
  return out;
}

// The reference's means over blocks, and their variances: pixels are sampled independently.
SampledPicture block_means(const SampledPicture& picture, int size) {
  SampledPicture out;
  out.width = (picture.width + size - 1) / size;
  out.height = (picture.height + size - 1) / size;
  out.renders = picture.renders;
  const size_t values = size_t(out.width) * out.height * 3;
  out.mean.assign(values, 0.0);
  out.variance.assign(values, 0.0);
  std::vector<int> pixels(values, 0);
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const size_t from = 3 * (size_t(y) * picture.width + x) + c;
        const size_t to = 3 * (size_t(y / size) * out.width + x / size) + c;
        out.mean[to] += picture.mean[from];
        out.variance[to] += picture.variance[from];
        ++pixels[to];
      }
    }
  }
  for (size_t i = 0; i < values; ++i) {
    out.mean[i] /= pixels[i];
    out.variance[i] /= double(pixels[i]) * pixels[i];
  }
  return out;
}

// Two-sided p-values of all values of two pictures of one size.
std::vector<double> p_values(const SampledPicture& picture, const SampledPicture& reference, double allowance,
                             bool same_law) {
  // Of a variance that is at least the reference's own; else the few renders of the picture alone vouch for it.
  const double freedom = same_law ? reference.renders - 1 : picture.renders - 1;
  std::vector<double> p(picture.mean.size());
  for (size_t i = 0; i < p.size(); ++i) {
    const double variance = std::max(picture.variance[i], reference.variance[i]) / picture.renders +
                            reference.variance[i] / reference.renders;
    const double excess =
        std::abs(picture.mean[i] - reference.mean[i]) - allowance - k_rounding * std::abs(reference.mean[i]);
    if (std::isnan(excess)) {
      p[i] = 0.0;
    } else if (excess <= 0.0) {
      p[i] = 1.0;
    } else {
      p[i] = variance > 0.0 ? two_sided_p(excess / std::sqrt(variance), freedom) : 0.0;
    }
  }
  return p;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return sum / double(values.size());
}

struct SquaredDifference {
  double mean = 0.0, deviation = 0.0;  // unbiased, and its standard deviation under normal noise
};

SquaredDifference squared_difference(const SampledPicture& picture, const SampledPicture& reference) {
  SquaredDifference out;
  double variance_of_sum = 0.0;
  for (size_t i = 0; i < picture.mean.size(); ++i) {
    const double d = picture.mean[i] - reference.mean[i];
    const double v = picture.variance[i] / picture.renders + reference.variance[i] / reference.renders;
    out.mean += d * d - v;
    // Var(d^2) = 2 v^2 + 4 v E(d)^2, and d^2 is at least what E(d)^2 is expected to be; the three channels of a pixel
    // may be one random number, which makes the variance of their sum up to three times as large.
    variance_of_sum += 3.0 * (2.0 * v * v + 4.0 * v * d * d);
  }
  out.mean /= double(picture.mean.size());
  out.deviation = std::sqrt(variance_of_sum) / double(picture.mean.size());
  return out;
}

Image to_image(const SampledPicture& picture, const std::vector<double>& values) {
  Image image{picture.width, picture.height, {"R", "G", "B"}, {}};
  image.data.assign(values.begin(), values.end());
  return image;
}

}  // namespace

double mean(const Image& image, size_t channel) {
  double sum = 0.0;
  const size_t n = image.channel_count();
  for (size_t i = channel; i < image.data.size(); i += n) sum += double(image.data[i]);
  return sum / double(image.data.size() / n);
}

double sidak_threshold(double level, double tests) { return -std::expm1(std::log1p(-level) / tests); }

double two_sided_p(double t, double degrees_of_freedom) {
  if (std::isinf(t)) return 0.0;
  return 2.0 * boost::math::cdf(boost::math::complement(boost::math::students_t(degrees_of_freedom), t));
}

SampledPicture sampled_picture(const std::vector<Image>& renders) {
  if (renders.size() < 2) throw Error({}, "a variance needs at least two renders");
  SampledPicture out;
  out.width = renders[0].width;
  out.height = renders[0].height;
  const size_t pixels = size_t(out.width) * out.height;
  out.mean.assign(3 * pixels, 0.0);
  out.variance.assign(3 * pixels, 0.0);
  // Welford's recurrence ("Note on a Method for Calculating Corrected Sums of Squares and Products", 1962).
  for (const Image& image : renders) {
    ++out.renders;
    for (size_t i = 0; i < pixels; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        const double value = image.data[i * image.channel_count() + c];
        const double before = value - out.mean[3 * i + c];
        out.mean[3 * i + c] += before / out.renders;
        out.variance[3 * i + c] += before * (value - out.mean[3 * i + c]);
      }
    }
  }
  for (double& v : out.variance) v /= out.renders - 1;
  return out;
}

void write_reference(const std::string& path, const SampledPicture& reference) {
  Image image{
      reference.width, reference.height, {"R", "G", "B", "variance.R", "variance.G", "variance.B", "renders.Y"}, {}};
  image.data.reserve(reference.mean.size() / 3 * 7);
  for (size_t i = 0; i < reference.mean.size(); i += 3) {
    for (size_t c = 0; c < 3; ++c) image.data.push_back(round_bits(reference.mean[i + c], 16));
    for (size_t c = 0; c < 3; ++c) image.data.push_back(round_bits(reference.variance[i + c] / reference.renders, 8));
    image.data.push_back(float(reference.renders));
  }
  ImageWriteOptions options;
  options.half = false;
  write_image(path, image, options);
}

SampledPicture read_reference(const std::string& path) {
  const Image image = read_image(path);
  const char* names[7] = {"R", "G", "B", "variance.R", "variance.G", "variance.B", "renders.Y"};
  int channel[7];
  for (int c = 0; c < 7; ++c) {
    channel[c] = image.channel_index(names[c]);
    if (channel[c] < 0) throw Error({path}, std::string("is no reference: it has no channel ") + names[c]);
  }
  SampledPicture out;
  out.width = image.width;
  out.height = image.height;
  out.renders = int(image.pixel(0, 0)[channel[6]]);
  if (out.renders < 2) throw Error({path}, "is no reference: renders.Y must be at least 2");
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        out.mean.push_back(image.pixel(x, y)[channel[c]]);
        out.variance.push_back(double(image.pixel(x, y)[channel[3 + c]]) * out.renders);
      }
    }
  }
  return out;
}

Agreement agreement(const std::vector<Image>& renders, const SampledPicture& reference,
                    const AgreementOptions& options) {
  const SampledPicture picture = sampled_picture(renders);
  if (picture.width != reference.width || picture.height != reference.height) {
    throw Error({}, fmt::format("a picture of {} x {} pixels cannot be compared with a reference of {} x {}",
                                picture.width, picture.height, reference.width, reference.height));
  }
  const auto level_of = [&](int size, double allowance) {
    std::vector<Image> means;
    for (const Image& image : renders) means.push_back(block_means(image, size));
    return p_values(sampled_picture(means), block_means(reference, size), allowance, options.same_law);
  };
  const Allowance& allowance = options.allowance;
  Agreement out;
  out.p_values = p_values(picture, reference, allowance.pixel, options.same_law);
  const std::vector<double> blocks = level_of(k_block, allowance.block);
  const std::vector<double> means = level_of(std::max(picture.width, picture.height), allowance.mean);

  const double tests = double(out.p_values.size() + blocks.size() + means.size() + (allowance.rmse > 0.0));
  out.threshold = sidak_threshold(options.level, tests * options.comparisons);
  const auto least = std::min_element(out.p_values.begin(), out.p_values.end());
  const int worst = int(least - out.p_values.begin()) / 3;
  out.worst_pixel = {worst % picture.width, worst / picture.width};
  out.least_pixel = *least;
  out.least_block = *std::min_element(blocks.begin(), blocks.end());
  out.least_mean = *std::min_element(means.begin(), means.end());
  for (const double p : out.p_values) out.refused_pixels += p < out.threshold;

  const double level = mean_of(reference.mean);
  const SquaredDifference squared = squared_difference(picture, reference);
  out.mean_difference = mean_of(picture.mean) / level - 1.0;
  out.added_rmse = std::sqrt(std::max(squared.mean, 0.0)) / level;
  if (allowance.rmse > 0.0) {
    const double excess = squared.mean - allowance.rmse * allowance.rmse;
    if (!(excess <= 0.0)) {
      out.of_rmse = squared.deviation > 0.0
                        ? boost::math::cdf(boost::math::complement(boost::math::normal(), excess / squared.deviation))
                        : 0.0;
    }
  }
  out.passed = std::min({out.least_pixel, out.least_block, out.least_mean, out.of_rmse}) >= out.threshold;
  return out;
}

std::string Agreement::summary() const {
  return fmt::format(
      "threshold {:.2e}; least p-value of pixels {:.2e} (at {}, {}; {} values refused), of blocks {:.2e}, of the mean "
      "{:.2e}, of the RMSE {:.2e}; mean {:+.3f} %, error beyond noise {:.3f} % of the mean",
      threshold, least_pixel, worst_pixel[0], worst_pixel[1], refused_pixels, least_block, least_mean, of_rmse,
      100.0 * mean_difference, 100.0 * added_rmse);
}

std::vector<std::string> write_evidence(const std::string& folder, const std::string& name,
                                        const SampledPicture& picture, const SampledPicture& reference,
                                        const Agreement& found) {
  std::filesystem::create_directories(folder);
  const double level = mean_of(reference.mean);
  std::vector<double> difference(picture.mean.size()), shown_difference(difference), shown_p(difference);
  for (size_t i = 0; i < difference.size(); ++i) {
    difference[i] = picture.mean[i] - reference.mean[i];
    // The curve of .png is undone, so that equal steps of difference look equal.
    shown_difference[i] = srgb_decode(std::clamp(float(0.5 + 0.5 * difference[i] / (0.05 * level)), 0.0f, 1.0f));
    // A logarithmic scale: 1 is black, the threshold white.
    const double p = std::max(found.p_values[i], 1e-300);
    shown_p[i] = srgb_decode(std::clamp(float(std::log(p) / std::log(found.threshold)), 0.0f, 1.0f));
  }
  std::vector<std::string> paths;
  const auto write = [&](const char* what, const std::vector<double>& exr, const std::vector<double>& png) {
    const std::string path = folder + "/" + name + "_" + what;
    ImageWriteOptions options;
    options.half = false;
    write_image(path + ".exr", to_image(picture, exr), options);
    write_image(path + ".png", to_image(picture, png));
    paths.push_back(path + ".exr");
    paths.push_back(path + ".png");
  };
  write("picture", picture.mean, picture.mean);
  write("reference", reference.mean, reference.mean);
  write("difference", difference, shown_difference);
  write("p_values", found.p_values, shown_p);
  return paths;
}

}  // namespace fieldtrace::test
