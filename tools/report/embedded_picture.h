// Pictures within a page: what a display shows of an image, differences and maps of errors in false colours.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/math/math.h"

namespace fieldtrace {

// Pictures with more pixels a side are reduced by a whole factor, blocks of pixels to their means.
inline constexpr int k_most_embedded_side = 1024;

// "data:image/png;base64,..." of the channels R, G and B, linear radiance in sRGB. `scratch_folder` must exist and be
// writable: the image library writes only files. Throws Error if the file cannot be written.
std::string png_data_uri(const Image& image, const std::string& scratch_folder);

// |a - b| times `gain`, per channel; R, G and B alone. Unchecked: both have them, and one size.
Image difference_picture(const Image& a, const Image& b, double gain);

// The power of two, 1 at least, that brings most differences of `images` to `reference` into view: 99 values of 100 are
// at most 1 after it.
double difference_gain(const std::vector<const Image*>& images, const Image& reference);

// From black by violet and orange to light yellow, as errors go from 0 to 1: each step is lighter than the one before.
Rgb error_colour(float error);  // as displayed (sRGB), each in [0, 1]

// `errors`: width * height. In colours by error_colour().
Image error_picture(const std::vector<float>& errors, int width, int height);

// Which of two images is nearer to the reference, per pixel, by the sum of squares over R, G and B.
struct NearerMap {
  Image picture;                           // first_colour() or second_colour(); grey where both are as near
  double first = 0, second = 0, both = 0;  // shares of the pixels
};
NearerMap nearer_map(const Image& first, const Image& second, const Image& reference);
Rgb nearer_first_colour();   // blue, as displayed
Rgb nearer_second_colour();  // orange

// A scale of error_colour() from 0 to 1, as an <svg> element.
std::string error_scale();

}  // namespace fieldtrace
