// Reads the files that most pictures and environment maps are, plain EXR and Radiance HDR, without OpenImageIO, whose
// opening takes .14 s (docs/decisions/021-start-up.md).
//
// Thread-safety: the function may be called from any thread.
#pragma once

#include <string>

#include "core/image/image_decoder.h"

namespace fieldtrace {

// Reads the file at `path`, which must be a regular file, into `result`, with the values and the order of channels that
// OpenImageIO gives. Returns false, and leaves `result` as it is, where that must read it or say what is wrong with it:
// other formats, EXRs of several parts, of layers or with subsampled channels, Radiance files of other encodings,
// headers that promise more than a file of that size or memory can hold, and damaged or truncated files.
bool read_plain_image(const std::string& path, DecodedImage& result);

}  // namespace fieldtrace
