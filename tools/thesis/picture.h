// Image differences as measured in the thesis, and images for an HTML page.
//
// Thread-safety: pure functions.
#pragma once

#include <string>

#include "tools/thesis/render.h"

namespace fieldtrace {

// Root mean squared difference over all pixels and channels, of values 0 ... 255 (rounded to 8 bits). Unchecked: both
// images have the same size.
double rms_255(const PhongPicture& a, const PhongPicture& b);

// Separable Gaussian of 5 x 5 weights, standard deviation 1 pixel; the border is repeated.
PhongPicture blurred(const PhongPicture& picture);

// |a - b| times `gain`, clamped.
PhongPicture difference(const PhongPicture& a, const PhongPicture& b, float gain);

// "data:image/png;base64,...". `scratch_folder` must exist and be writable: the image library writes only files. Throws
// Error if the file cannot be written.
std::string png_data_uri(const PhongPicture& picture, const std::string& scratch_folder);

}  // namespace fieldtrace
