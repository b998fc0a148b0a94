#include "core/image/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <utility>

#include "core/io/atomic_file.h"
#include "core/io/input_file.h"
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

// OpenImageIO writes through this proxy because its PNG writer ignores failed writes.
class CheckedProxy : public OIIO::Filesystem::IOProxy {
 public:
  explicit CheckedProxy(const std::string& path) : IOProxy(path, Write), file_(path) {}
  const char* proxytype() const override { return "checked"; }
  size_t write(const void* data, size_t size) override {
    const size_t written = pwrite(data, size, m_pos);
    m_pos += int64_t(written);
    return written;
  }
  size_t pwrite(const void* data, size_t size, int64_t offset) override {
    return file_.write_at(uint64_t(offset), data, size) ? size : 0;
  }
  size_t size() const override { return size_t(file_.end()); }
  CheckedFile& file() { return file_; }

 private:
  CheckedFile file_;
};

template <class T>
void write_pixels(const std::string& path, const char* format_name, const OIIO::ImageSpec& spec, const T* pixels) {
  AtomicFile file(path);
  CheckedProxy proxy(file.temporary_path());
  const auto fail = [&](const std::string& reason) {
    throw Error({path}, "cannot be written: " + (proxy.file().failed() ? proxy.file().reason() : reason));
  };
  const auto output = OIIO::ImageOutput::create(format_name);
  if (!output) fail(OIIO::geterror());
  if (!output->set_ioproxy(&proxy)) fail("OpenImageIO cannot write this format through a proxy");
  if (!output->open(file.temporary_path(), spec)) fail(output->geterror());
  if (!output->write_image(OIIO::BaseTypeFromC<T>::value, pixels)) fail(output->geterror());
  if (!output->close()) fail(output->geterror());
  proxy.file().close();
  if (proxy.file().failed() || proxy.file().end() == 0) fail("nothing was written");
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
        // Infinity and NaN are kept as evidence of an error.
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

namespace {

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

// Throws Error for dimensions that a file of this size cannot hold, before a corrupt header can cause a huge
// allocation.
void require_fitting_size(const std::string& path, const OIIO::ImageSpec& spec, double values_per_byte) {
  const auto bytes = std::filesystem::file_size(path);
  if (double(spec.width) * spec.height * spec.nchannels <= values_per_byte * double(bytes)) return;
  throw Error({path}, "cannot be read as an image: its header tells of " + std::to_string(spec.width) + " x " +
                          std::to_string(spec.height) + " pixels, more than its " + std::to_string(bytes) +
                          " bytes can hold; the file is cut off or damaged");
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
  if (!input) {
    throw Error({path}, "cannot be read as an image: " +
                            reason_or(OIIO::geterror(), "its header is damaged or of an unknown format"));
  }
  const OIIO::ImageSpec& spec = input->spec();
  const uint64_t values = uint64_t(std::max(spec.width, 0)) * std::max(spec.height, 0) * std::max(spec.nchannels, 0);
  if (values == 0 || values > k_max_values || spec.depth > 1) {
    throw Error({path}, "cannot be read as an image: it has no pixels, too many or a third dimension");
  }
  require_fitting_size(path, spec, most_values_per_byte(input->format_name(), spec));
  return input;
}

Image read_pixels(const std::string& path, const ImageReadOptions& options) {
  const auto input = open_image(path);
  const OIIO::ImageSpec& spec = input->spec();
  Image image;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = spec.channelnames;
  image.data.resize(size_t(spec.width) * spec.height * spec.nchannels);
  const bool encoded = spec.format == OIIO::TypeDesc::UINT8;
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data())) {
    throw Error({path}, "cannot be read as an image: " +
                            reason_or(input->geterror(), "its pixels end early; the file is cut off or damaged"));
  }
  if (encoded && options.linearise) {
    for (size_t i = 0; i < image.data.size(); ++i) {
      if (image.channels[i % image.channel_count()] != "A") image.data[i] = srgb_decode(image.data[i]);
    }
  }
  return image;
}

}  // namespace

Image read_image(const std::string& path, const ImageReadOptions& options) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) throw Error({path}, "no such file; check the name");
  if (std::filesystem::is_directory(path, ignored)) throw Error({path}, "it is a folder; name an image file");
  require_regular_file(path);
  try {
    return read_pixels(path, options);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    // The standard library throws this through OpenImageIO where a damaged header leads to an absurd allocation.
    throw Error({path}, std::string("cannot be read as an image: it is damaged or needs too much memory (") +
                            error.what() + ")");
  }
}

}  // namespace fieldtrace
