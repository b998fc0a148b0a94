// Pictures beside a reference: how far each is from it, and the part of a page that shows this.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "core/image/image.h"
#include "hybrid/compare/compare.h"
#include "hybrid/compare/flip.h"

namespace fieldtrace {

struct ComparedPicture {
  std::string name;  // text
  const Image* image = nullptr;
  ImageDifference difference;
  FlipMap flip, hdr_flip;
};

// `image` must outlive the result. Throws what compare_images() and ldr_flip() throw.
ComparedPicture compare_picture(const std::string& name, const Image& image, const Image& reference);

// The pictures and the reference, then their differences, one gain for all, then their FLIP maps; each with a caption,
// and explained. HTML. `scratch_folder`: as for png_data_uri().
std::string picture_figures(const std::vector<ComparedPicture>& pictures, const std::string& reference_name,
                            const Image& reference, const std::string& scratch_folder);

// The page of `fieldtrace compare --report`. `command`: as typed; `how`: of which pixels, text.
std::string compare_page(const ComparedPicture& picture, const std::string& reference_name, const Image& reference,
                         const std::string& how, const std::string& command, const std::string& version,
                         const std::string& scratch_folder);

}  // namespace fieldtrace
