#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "core/image/image_decoder.h"

namespace fieldtrace {
namespace {

// Protects the allocation against a damaged header: 2^31 floats are 8 GiB.
constexpr uint64_t k_max_values = uint64_t(1) << 31;

// What is wrong with a file.
using Failure = std::runtime_error;

// The most values (every channel of every pixel counted) that one byte of a file can encode, by OpenImageIO's name of
// the format. Each is the best case of the format's compression; infinity where that has no bound (a WebP image of one
// colour is a few bytes at any size).
double most_values_per_byte(const std::string& format, const OIIO::ImageSpec& spec) {
  // 8 pixels of a palette of two colours with alpha: 4 channels each.
  constexpr double k_uncompressed = 32;
  // Deflate (RFC 1951) encodes a run of 258 bytes in 2 bits, one for the length and one for the distance.
  constexpr double k_deflate = 1032;
  // OpenImageIO reports a BMP's compression only if it has one.
  const bool plain = spec.get_string_attribute("compression", format == "bmp" ? "none" : "") == "none";
  if (format == "pnm") return 8;      // 1-bit grey; never compressed
  if (format == "hdr") return 48;     // runs of 127 in 2 bytes for each of 4 components: 3 * 127 / 8
  if (format == "targa") return 256;  // runs of 128 pixels in 2 bytes, through a palette with alpha
  if (format == "gif") return 10924;  // LZW: 12 bits for strings of at most 2^12 pixels, 4 channels each
  if (format == "png") return k_deflate * k_uncompressed;
  // DWA deflates one coefficient of 2 bytes for each block of 8 x 8 values.
  if (format == "openexr") return k_deflate / 2 * 64;
  if ((format == "bmp" || format == "tiff") && plain) return k_uncompressed;
  return std::numeric_limits<double>::infinity();
}

// Throws Failure for dimensions that a file of this size cannot hold, before a corrupt header can cause a huge
// allocation.
void require_fitting_size(const std::string& path, const OIIO::ImageSpec& spec, double values_per_byte) {
  const auto bytes = std::filesystem::file_size(path);
  if (double(spec.width) * spec.height * spec.nchannels <= values_per_byte * double(bytes)) return;
  throw Failure("its header tells of " + std::to_string(spec.width) + " x " + std::to_string(spec.height) +
                " pixels, more than its " + std::to_string(bytes) + " bytes can hold; the file is cut off or damaged");
}

// OpenImageIO allocates a GIF's canvas on opening the file, so the header has to be checked first.
void check_gif_header(const std::string& path) {
  unsigned char head[10] = {};  // "GIF89a", width, height: 2 bytes each, little endian
  std::ifstream(path, std::ios::binary).read(reinterpret_cast<char*>(head), sizeof head);
  if (!std::equal(head, head + 4, "GIF8")) return;
  const OIIO::ImageSpec spec(head[6] | head[7] << 8, head[8] | head[9] << 8, 4);
  require_fitting_size(path, spec, most_values_per_byte("gif", spec));
}

std::string reason_or(std::string reason, const char* otherwise) {
  return reason.empty() ? std::string(otherwise) : std::move(reason);
}

std::unique_ptr<OIIO::ImageInput> open_image(const std::string& path) {
  check_gif_header(path);
  OIIO::ImageSpec hints;
  hints.attribute("oiio:UnassociatedAlpha", 1);  // straight colours, not premultiplied by alpha
  auto input = OIIO::ImageInput::open(path, &hints);
  if (!input) throw Failure(reason_or(OIIO::geterror(), "its header is damaged or of an unknown format"));
  const OIIO::ImageSpec& spec = input->spec();
  const uint64_t values = uint64_t(std::max(spec.width, 0)) * std::max(spec.height, 0) * std::max(spec.nchannels, 0);
  if (values == 0 || values > k_max_values || spec.depth > 1) {
    throw Failure("it has no pixels, too many or a third dimension");
  }
  require_fitting_size(path, spec, most_values_per_byte(input->format_name(), spec));
  return input;
}

}  // namespace

extern "C" DecodedImage fieldtrace_decode_image(const std::string& path) {
  DecodedImage result;
  const auto input = open_image(path);
  const OIIO::ImageSpec& spec = input->spec();
  Image& image = result.image;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = spec.channelnames;
  image.data.resize(size_t(spec.width) * spec.height * spec.nchannels);
  result.is_integer = !spec.format.is_floating_point();
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data())) {
    throw Failure(reason_or(input->geterror(), "its pixels end early; the file is cut off or damaged"));
  }
  return result;
}

// The program calls it by this type.
static_assert(std::is_same_v<decltype(fieldtrace_decode_image), ImageDecoder>);

}  // namespace fieldtrace
