#include "core/image/image.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <filesystem>

#include "core/io/atomic_file.h"
#include "core/platform/error.h"

namespace fieldtrace {

namespace {

enum class Format { exr, png };

// Largest finite half (IEEE 754 binary16): (2 - 2^-10) * 2^15.
constexpr float k_half_max = 65504.0f;

// Protects the allocation against a damaged header: 2^31 floats are 8 GiB.
constexpr uint64_t k_max_values = uint64_t(1) << 31;

Format format_of(const std::string& path) {
  std::string ending = std::filesystem::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (ending == ".exr") return Format::exr;
  if (ending == ".png") return Format::png;
  throw Error({path}, "unknown image format '" + ending + "'; end the name in .exr or .png");
}

void require_consistent(const std::string& path, const Image& image) {
  const size_t expected = size_t(std::max(image.width, 0)) * size_t(std::max(image.height, 0)) * image.channel_count();
  if (expected == 0 || image.data.size() != expected) {
    throw Error({path}, "an image without pixels or with the wrong amount of data cannot be written");
  }
}

// Distances and identifiers need more than the 11 significant bits of half.
bool needs_full_float(const std::string& channel) {
  for (const char* layer : {"depth.", "position.", "object.", "reflected_depth.", "reflected_object."}) {
    if (channel.rfind(layer, 0) == 0) return true;
  }
  return false;
}

template <class T>
void write_pixels(const std::string& path, const char* format_name, const OIIO::ImageSpec& spec, const T* pixels) {
  AtomicFile file(path);
  const auto fail = [&](const std::string& reason) { throw Error({path}, "cannot be written: " + reason); };
  const auto output = OIIO::ImageOutput::create(format_name);
  if (!output) fail(OIIO::geterror());
  if (!output->open(file.temporary_path(), spec)) fail(output->geterror());
  if (!output->write_image(OIIO::BaseTypeFromC<T>::value, pixels)) fail(output->geterror());
  if (!output->close()) fail(output->geterror());
  file.commit();
}

void write_exr(const std::string& path, const Image& image, const ImageWriteOptions& options) {
  const OIIO::TypeDesc colour = options.half ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT;
  OIIO::ImageSpec spec(image.width, image.height, int(image.channel_count()), colour);
  spec.channelnames = image.channels;
  for (const std::string& name : image.channels) {
    spec.channelformats.push_back(needs_full_float(name) ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : colour);
  }
  spec.attribute("compression", "zip");
  spec.attribute("oiio:ColorSpace", "Linear");
  for (const auto& [name, value] : options.metadata) spec.attribute(name, value);

  std::vector<float> data = image.data;
  if (options.half) {
    const size_t stride = image.channel_count();
    for (size_t c = 0; c < stride; ++c) {
      if (needs_full_float(image.channels[c])) continue;
      for (size_t i = c; i < data.size(); i += stride) {
        // Infinity and NaN are kept: they tell that something went wrong.
        if (std::isfinite(data[i])) data[i] = std::clamp(data[i], -k_half_max, k_half_max);
      }
    }
  }
  write_pixels(path, "openexr", spec, data.data());
}

void write_png(const std::string& path, const Image& image, const ImageWriteOptions& options) {
  std::array<int, 3> channel;
  for (int c = 0; c < 3; ++c) {
    channel[c] = image.channel_index(std::string(1, "RGB"[c]));
    if (channel[c] < 0) throw Error({path}, "a PNG needs the channels R, G and B; write an .exr instead");
  }
  const float scale = std::exp2(options.exposure);
  std::vector<uint8_t> pixels(size_t(image.width) * image.height * 3);
  for (size_t i = 0; i < pixels.size() / 3; ++i) {
    const float* source = &image.data[i * image.channel_count()];
    for (int c = 0; c < 3; ++c) {
      pixels[3 * i + c] = uint8_t(std::lround(255.0f * srgb_encode(scale * source[channel[c]])));
    }
  }
  OIIO::ImageSpec spec(image.width, image.height, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  write_pixels(path, "png", spec, pixels.data());
}

}  // namespace

void write_image(const std::string& path, const Image& image, const ImageWriteOptions& options) {
  const Format format = format_of(path);
  require_consistent(path, image);
  if (format == Format::exr) {
    write_exr(path, image, options);
  } else {
    write_png(path, image, options);
  }
}

void require_image_writable(const std::string& path) {
  format_of(path);
  require_writable(path);
}

Image read_image(const std::string& path, const ImageReadOptions& options) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) throw Error({path}, "no such file; check the name");
  if (std::filesystem::is_directory(path, ignored)) throw Error({path}, "it is a folder; name an image file");

  OIIO::ImageSpec hints;
  hints.attribute("oiio:UnassociatedAlpha", 1);  // colours as stored, not multiplied by alpha
  const auto input = OIIO::ImageInput::open(path, &hints);
  if (!input) throw Error({path}, "cannot be read as an image: " + OIIO::geterror());
  const OIIO::ImageSpec& spec = input->spec();
  const uint64_t values = uint64_t(std::max(spec.width, 0)) * std::max(spec.height, 0) * std::max(spec.nchannels, 0);
  if (values == 0 || values > k_max_values || spec.depth > 1) {
    throw Error({path}, "cannot be read as an image: it has no pixels, too many or a third dimension");
  }

  Image image;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = spec.channelnames;
  image.data.resize(values);
  const bool encoded = spec.format == OIIO::TypeDesc::UINT8;
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data())) {
    throw Error({path}, "cannot be read as an image: " + input->geterror());
  }
  if (encoded && options.linearise) {
    for (size_t i = 0; i < image.data.size(); ++i) {
      if (image.channels[i % image.channel_count()] != "A") image.data[i] = srgb_decode(image.data[i]);
    }
  }
  return image;
}

}  // namespace fieldtrace
