// What reads image files of any format: OpenImageIO, behind a plain function in a module (core/platform/module.h).
//
// Thread-safety: the function may be called from any thread.
#pragma once

#include <map>
#include <string>

#include "core/image/image.h"

namespace fieldtrace {

inline constexpr const char* k_image_decoder_module = "image_formats";
inline constexpr const char* k_image_decoder_function = "fieldtrace_decode_image";

struct DecodedImage {
  Image image;              // every channel as stored, integers divided by the largest of their type
  bool is_integer = false;  // stored as integers
  std::map<std::string, std::string> metadata;  // strings of the header
};

// Reads the first picture of the file at `path`, which must be a regular file, into `result`. Throws std::runtime_error
// that says what is wrong with the file, or what the standard library throws where a damaged header asks for absurd
// amounts.
using ImageDecoder = void(const std::string& path, DecodedImage& result);

}  // namespace fieldtrace
