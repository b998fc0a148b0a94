// Whether a picture that is known by a few independent renders agrees with a reference that is known by many.
//
// Every pixel and channel, every block of pixels and the whole picture is tested by itself (as in Subr and Arvo,
// "Statistical Hypothesis Testing for Assessing Monte Carlo Estimators", Pacific Graphics 2007), against a threshold
// that Sidak's correction derives from one family-wise level ("Rectangular Confidence Regions for the Means of
// Multivariate Normal Distributions", JASA 62, 1967). Channels and nested blocks are dependent, which makes the level
// an upper bound. Pictures have the channels R, G, B first; further ones are left out.
// Thread-safety: values and pure functions.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/image/image.h"

namespace fieldtrace::test {

// The mean of one channel of a picture that holds pixels.
double mean(const Image& image, size_t channel = 0);

// What independent renders tell about a picture. Arrays: width * height * 3.
struct SampledPicture {
  int width = 0, height = 0;
  int renders = 0;
  std::vector<double> mean;
  std::vector<double> variance;  // of one render, unbiased
};

// At least two renders of one size, each with another seed.
SampledPicture sampled_picture(const std::vector<Image>& renders);

// A reference in a file: R, G, B, their variances of the mean as variance.R, ..., and the number of renders as
// renders.Y. Means keep 16 significant bits and variances 8, so that the file stays small. Both throw Error.
void write_reference(const std::string& path, const SampledPicture& reference);
SampledPicture read_reference(const std::string& path);

// How far the expected picture may be from the expected reference, in radiance; 0 for an unbiased method.
struct Allowance {
  double pixel = 0.0;  // of any pixel
  double block = 0.0;  // of the mean of any block of k_block^2 pixels
  double mean = 0.0;   // of the picture's mean
  double rmse = 0.0;   // of the root mean square error over all pixels, noise taken off; only tested where not 0
};

inline constexpr int k_block = 8;

struct AgreementOptions {
  double level = 0.01;   // probability that any of `comparisons` pictures without fault is refused
  int comparisons = 1;   // pictures that share the level
  bool same_law = true;  // renders are drawn as those of the reference are: Monte Carlo against Monte Carlo
  Allowance allowance;
};

struct Agreement {
  bool passed = false;
  double threshold = 0.0;        // least p-value that passes
  std::vector<double> p_values;  // per pixel and channel
  double least_pixel = 1.0;      // least p-values
  double least_block = 1.0, least_mean = 1.0, of_rmse = 1.0;
  int refused_pixels = 0;               // pixels and channels below the threshold
  std::array<int, 2> worst_pixel = {};  // x, y of least_pixel
  double mean_difference = 0.0;         // picture minus reference, over the reference's mean
  double added_rmse = 0.0;              // square root of the mean squared difference beyond noise, over the same
  std::string summary() const;          // one line
};

// The variance of a render is taken as the larger of the picture's own and the reference's, which only makes the test
// milder: a pixel that few renders happen to see all alike is not taken to be without noise.
Agreement agreement(const std::vector<Image>& renders, const SampledPicture& reference,
                    const AgreementOptions& options = {});

// Writes picture, reference, difference and p-values as .exr and .png into `folder` (made if it is missing), their
// names beginning with `name`, and returns their paths. In the .png of differences 0 is grey and 5 % of the reference's
// mean black or white; in that of p-values what is refused is white.
std::vector<std::string> write_evidence(const std::string& folder, const std::string& name,
                                        const SampledPicture& picture, const SampledPicture& reference,
                                        const Agreement& found);

// 1 - (1 - level)^(1 / tests): the threshold for each of many p-values. level in (0, 1), tests > 0.
double sidak_threshold(double level, double tests);

// P(|T| >= t) of Student's distribution; t >= 0.
double two_sided_p(double t, double degrees_of_freedom);

}  // namespace fieldtrace::test
