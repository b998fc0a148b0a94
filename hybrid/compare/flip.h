// FLIP: how much two pictures differ to an observer who alternates between them.
//
// LDR-FLIP: Andersson, Nilsson, Akenine-Moeller, Oskarsson, Astroem, Fairchild, "FLIP: A Difference Evaluator for
// Alternating Images", HPG 2020, sections 4 and 5; numbers of sections in flip.cpp are those of this paper. HDR-FLIP:
// Andersson, Nilsson, Shirley, Akenine-Moeller, "Visualizing Errors in Rendered High Dynamic Range Images",
// Eurographics 2021 (short papers), section 3, with the tone mapping that it proposes.
//
// Both take linear radiance of the channels R, G and B. LDR-FLIP compares what a display shows of it: values clamped to
// [0, 1] with sRGB's primaries. HDR-FLIP is at each pixel the largest LDR-FLIP over a range of exposures, tone mapped;
// negative values count as 0. Memory layout: row 0 at the top.
// Thread-safety: pure functions, which use TBB's threads. Results do not depend on threads.
#pragma once

#include <optional>
#include <vector>

#include "core/image/image.h"

namespace fieldtrace {

// The papers' display: 3840 pixels on 0.7 m, seen from 0.7 m. In pixels per degree.
inline constexpr double k_flip_pixels_per_degree = 0.7 * (3840.0 / 0.7) * 3.14159265358979323846 / 180.0;

// Exposures of HDR-FLIP, from start to stop in equal steps, in stops (powers of two).
struct FlipExposures {
  double start = 0.0, stop = 0.0;
  int count = 1;  // >= 1; of one, `start` alone counts
};

struct FlipMap {
  int width = 0, height = 0;
  std::vector<float> errors;  // each in [0, 1]; width * height
  double mean = 0.0;          // over all pixels
};

// Throw Error if the sizes differ, if there are no pixels, or if an image lacks R, G or B. Values that are not finite
// make the mean NaN; in the map they count as 0.
FlipMap ldr_flip(const Image& image, const Image& reference, double pixels_per_degree = k_flip_pixels_per_degree);

// Without `exposures`: flip_exposures(reference).
FlipMap hdr_flip(const Image& image, const Image& reference, const std::optional<FlipExposures>& exposures = {},
                 double pixels_per_degree = k_flip_pixels_per_degree);

// The exposures that show all of a picture (2021, section 3.2): from that at which its brightest pixel to that at which
// its median pixel is tone mapped to 0.85, at steps of a stop at most. A picture whose median is black has some 25.
// Throws Error if the image has no pixels or lacks R, G or B.
FlipExposures flip_exposures(const Image& reference);

}  // namespace fieldtrace
