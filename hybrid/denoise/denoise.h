// Removes the noise of finished pictures by Intel Open Image Denoise (Afra, https://www.openimagedenoise.org), guided
// by the layers denoise_albedo and denoise_normal (hybrid/path/aovs.h).
//
// What is removed is guessed by a network: the result has an error of its own, which nothing here bounds. It depends on
// the library's version and on the machine's instruction set, in the last digits. Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "core/image/image.h"

namespace fieldtrace {

// Throws UsageError, which says how to get it, if the program was built without the library.
void require_denoiser();

// The layers that denoise() reads.
const std::vector<std::string>& denoise_layers();

struct DenoiseOptions {
  int threads = 0;  // 0: all
  // Whether albedo and normals have noise of their own, as those of a lens out of focus do: they are then filtered
  // first, which takes two thirds of the time.
  bool noisy_layers = false;
};

// Replaces R, G and B of `image`, which has the channels of denoise_layers(); other channels stay. Returns the name and
// version of what denoised. Throws Error if that fails; the image is then unchanged.
std::string denoise(Image& image, const DenoiseOptions& options);

// Removes the channels of those layers that `kept` does not name.
void drop_denoise_layers(Image& image, const std::vector<std::string>& kept);

}  // namespace fieldtrace
