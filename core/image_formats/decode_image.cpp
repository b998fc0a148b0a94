#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>

#include "core/image/image_decoder.h"
#include "core/image_formats/image_headers.h"

namespace fieldtrace {
namespace {

std::string reason_or(std::string reason, const char* otherwise) {
  return reason.empty() ? std::string(otherwise) : std::move(reason);
}

std::unique_ptr<OIIO::ImageInput> open_image(const std::string& path) {
  check_own_header(path);
  OIIO::ImageSpec hints;
  hints.attribute("oiio:UnassociatedAlpha", 1);  // straight colours, not premultiplied by alpha
  auto input = OIIO::ImageInput::open(path, &hints);
  if (!input) throw Failure(reason_or(OIIO::geterror(), "its header is damaged or of an unknown format"));
  const OIIO::ImageSpec& spec = input->spec();
  const uint64_t values = uint64_t(std::max(spec.width, 0)) * std::max(spec.height, 0) * std::max(spec.nchannels, 0);
  if (values == 0 || values > k_most_image_values || spec.depth > 1) {
    throw Failure("it has no pixels, too many or a third dimension");
  }
  check_size(path, input->format_name(), spec);
  return input;
}

// By single rows where TIFF stores rows: by several, OpenImageIO takes no notice of deflated data that end early. Where
// each channel is stored by itself, single rows would be decoded over and over.
bool read_pixels(OIIO::ImageInput& input, float* to) {
  const OIIO::ImageSpec& spec = input.spec();
  const bool by_rows = std::string(input.format_name()) == "tiff" && spec.tile_width == 0 &&
                       spec.get_string_attribute("planarconfig") != "separate";
  if (!by_rows) return input.read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, to);
  const size_t row = size_t(spec.width) * spec.nchannels;
  for (int y = 0; y < spec.height; ++y) {
    if (!input.read_scanline(spec.y + y, spec.z, OIIO::TypeDesc::FLOAT, to + size_t(y) * row)) return false;
  }
  return true;
}

// OpenImageIO does not always fail where the decoder met the end of the data, but keeps its message. A JPEG decoder's
// other messages are of harmless oddities.
bool ends_early(const OIIO::ImageInput& input, const std::string& message) {
  const std::string format = input.format_name();
  return (format == "tiff" && !message.empty()) ||
         (format == "jpeg" && message.find("remature end") != std::string::npos);
}

}  // namespace

extern "C" void fieldtrace_decode_image(const std::string& path, DecodedImage& result) {
  const auto input = open_image(path);
  const OIIO::ImageSpec& spec = input->spec();
  Image& image = result.image;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = spec.channelnames;
  image.data.resize(size_t(spec.width) * spec.height * spec.nchannels);
  result.is_integer = !spec.format.is_floating_point();
  for (const OIIO::ParamValue& value : spec.extra_attribs) {
    if (value.type() == OIIO::TypeString) result.metadata[value.name().string()] = value.get_string();
  }
  input->geterror();  // of what came before the pixels
  const bool whole = read_pixels(*input, image.data.data());
  const std::string message = input->geterror();
  if (!whole || ends_early(*input, message)) {
    throw Failure(reason_or(message, "its pixels end early; the file is cut off or damaged"));
  }
}

// The program calls it by this type.
static_assert(std::is_same_v<decltype(fieldtrace_decode_image), ImageDecoder>);

}  // namespace fieldtrace
