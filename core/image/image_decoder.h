// What reads image files of any format: OpenImageIO, behind a plain function in a module (core/platform/module.h).
//
// Thread-safety: the function may be called from any thread.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "core/image/image.h"

namespace fieldtrace {

inline constexpr const char* k_image_decoder_module = "image_formats";
inline constexpr const char* k_image_decoder_function = "fieldtrace_decode_image";

// What headers may promise, before memory is taken for it. All: 2^31 floats are 8 GiB.
inline constexpr uint64_t k_most_image_values = uint64_t(1) << 31;
// The most values (every channel of every pixel counted) that a byte of a file can encode. EXR: DWA deflates (1,032
// bytes a byte) one coefficient of 2 bytes for each block of 8 x 8 values. Radiance: runs of 127 in 2 bytes for each of
// 4 components, 3 * 127 / 8.
inline constexpr double k_exr_values_per_byte = 1032 / 2 * 64, k_hdr_values_per_byte = 48;

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
