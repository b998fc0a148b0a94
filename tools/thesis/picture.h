// Image differences as measured in the thesis.
//
// Thread-safety: pure functions.
#pragma once

#include "core/image/image.h"
#include "tools/thesis/render.h"

namespace fieldtrace {

// Root mean squared difference over all pixels and channels, of values 0 ... 255 (rounded to 8 bits). Unchecked: both
// images have the same size.
double rms_255(const PhongPicture& a, const PhongPicture& b);

// Separable Gaussian of 5 x 5 weights, standard deviation 1 pixel; the border is repeated.
PhongPicture blurred(const PhongPicture& picture);

// |a - b| times `gain`, clamped.
PhongPicture difference(const PhongPicture& a, const PhongPicture& b, float gain);

// The picture, of display values, as linear radiance.
Image to_image(const PhongPicture& picture);

}  // namespace fieldtrace
