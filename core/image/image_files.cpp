#include "core/image/image.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <stdexcept>
#include <thread>

#include "core/image/image_decoder.h"
#include "core/image/plain_images.h"
#include "core/io/atomic_file.h"
#include "core/io/file_ending.h"
#include "core/io/input_file.h"
#include "core/platform/error.h"
#include "core/platform/module.h"
#include "core/platform/parallel.h"

namespace fieldtrace {

namespace {

enum class Format { exr, png };

// Largest finite half (IEEE 754 binary16): (2 - 2^-10) * 2^15.
constexpr float k_half_max = 65504.0f;

Format format_of(const std::string& path) {
  const std::string ending = file_ending(path);
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
  for (const char* layer :
       {"depth.", "position.", "object.", "reflected_depth.", "reflected_object.", "samples.", "variance.", "time."}) {
    if (channel.rfind(layer, 0) == 0) return true;
  }
  return false;
}

// Writes the file at `path` by `write`; it fails if that throws, or if anything could not be written.
void write_file(const std::string& path, const std::function<void(CheckedFile&)>& write) {
  AtomicFile atomic(path);
  CheckedFile file(atomic.temporary_path());
  std::string reason;
  try {
    write(file);
    file.close();
    if (file.end() == 0) reason = "nothing was written";
  } catch (const std::exception& error) {
    reason = error.what();
  }
  if (file.failed()) reason = file.reason();
  if (!reason.empty()) throw Error({path}, "cannot be written: " + reason);
  atomic.commit();
}

// What OpenEXR writes through: it takes no notice of some writes that fail.
class CheckedStream : public Imf::OStream {
 public:
  explicit CheckedStream(CheckedFile& file) : OStream("image"), file_(file) {}
  void write(const char* data, int size) override {
    file_.write_at(at_, data, size_t(size));
    at_ += uint64_t(size);
  }
  uint64_t tellp() override { return at_; }
  void seekp(uint64_t at) override { at_ = at; }

 private:
  CheckedFile& file_;
  uint64_t at_ = 0;
};

// The pixels of an EXR, each a row of halves and floats, as OpenEXR takes them.
struct ExrPixels {
  explicit ExrPixels(const Image& image, const ImageWriteOptions& options) {
    for (const std::string& name : image.channels) {
      const Imf::PixelType type = options.half && !needs_full_float(name) ? Imf::HALF : Imf::FLOAT;
      types.push_back(type);
      offsets.push_back(pixel_bytes);
      pixel_bytes += type == Imf::HALF ? sizeof(Imath::half) : sizeof(float);
    }
    const size_t count = size_t(image.width) * size_t(image.height);
    bytes.resize(count * pixel_bytes);
    constexpr size_t task = size_t(1) << 14;
    tbb::this_task_arena::isolate([&] {
      parallel_for((count + task - 1) / task,
                   [&](size_t t) { fill(image, t * task, std::min((t + 1) * task, count)); });
    });
  }

  void fill(const Image& image, size_t begin, size_t end) {
    const size_t stride = image.channel_count();
    for (size_t i = begin; i < end; ++i) {
      for (size_t c = 0; c < stride; ++c) {
        char* const to = &bytes[i * pixel_bytes + offsets[c]];
        float value = image.data[i * stride + c];
        if (types[c] == Imf::FLOAT) {
          std::memcpy(to, &value, sizeof value);
          continue;
        }
        // Infinity and NaN are kept as evidence of an error.
        if (std::isfinite(value)) value = std::clamp(value, -k_half_max, k_half_max);
        const Imath::half rounded(value);
        std::memcpy(to, &rounded, sizeof rounded);
      }
    }
  }

  std::vector<Imf::PixelType> types;  // by channel
  std::vector<size_t> offsets;        // by channel, in a pixel
  size_t pixel_bytes = 0;
  std::vector<char> bytes;
};

// Threads for the compression, which takes longer than all else. OpenEXR keeps one pool for the whole process.
int compression_threads() {
  static const int threads = [] {
    Imf::setGlobalThreadCount(int(std::thread::hardware_concurrency()));
    return Imf::globalThreadCount();
  }();
  return threads;
}

void write_exr(CheckedFile& file, const Image& image, const ImageWriteOptions& options) {
  ExrPixels pixels(image, options);
  Imf::Header header(image.width, image.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [name, value] : options.metadata) header.insert(name, Imf::StringAttribute(value));
  Imf::FrameBuffer frame;
  for (size_t c = 0; c < image.channel_count(); ++c) {
    header.channels().insert(image.channels[c], Imf::Channel(pixels.types[c]));
    frame.insert(image.channels[c], Imf::Slice(pixels.types[c], pixels.bytes.data() + pixels.offsets[c],
                                               pixels.pixel_bytes, pixels.pixel_bytes * size_t(image.width)));
  }
  CheckedStream stream(file);
  Imf::OutputFile output(stream, header, compression_threads());
  output.setFrameBuffer(frame);
  output.writePixels(image.height);
}

// 8-bit sRGB values of the channels R, G and B.
std::vector<uint8_t> png_pixels(const std::string& path, const Image& image, float exposure) {
  const auto colours = colour_channels(image);
  if (!colours) throw Error({path}, "a PNG needs the channels R, G and B; write an .exr instead");
  const float scale = std::exp2(exposure);
  std::vector<uint8_t> pixels(size_t(image.width) * image.height * 3);
  for (size_t i = 0; i < pixels.size() / 3; ++i) {
    const float* source = &image.data[i * image.channel_count()];
    for (int c = 0; c < 3; ++c) {
      pixels[3 * i + c] = uint8_t(std::lround(255.0f * srgb_encode(scale * source[(*colours)[c]])));
    }
  }
  return pixels;
}

void write_png(CheckedFile& file, const Image& image, const std::vector<uint8_t>& pixels) {
  png_image header = {};
  header.version = PNG_IMAGE_VERSION;
  header.width = png_uint_32(image.width);
  header.height = png_uint_32(image.height);
  header.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(header);
  std::vector<char> encoded(size);
  if (!png_image_write_to_memory(&header, encoded.data(), &size, /*convert_to_8_bit=*/0, pixels.data(),
                                 /*row_stride=*/0, /*colormap=*/nullptr)) {
    throw std::runtime_error(header.message);
  }
  file.write_at(0, encoded.data(), size);
}

}  // namespace

void write_image(const std::string& path, const Image& image, const ImageWriteOptions& options) {
  const Format format = format_of(path);
  require_consistent(path, image);
  require_image_size(path, image.width, image.height);
  if (format == Format::exr) {
    write_file(path, [&](CheckedFile& file) { write_exr(file, image, options); });
  } else {
    const std::vector<uint8_t> pixels = png_pixels(path, image, options.exposure);
    write_file(path, [&](CheckedFile& file) { write_png(file, image, pixels); });
  }
}

void require_image_size(const std::string& path, int width, int height) {
  if (format_of(path) == Format::png && uint64_t(width) * uint64_t(height) * 3 > std::numeric_limits<uint32_t>::max()) {
    throw Error({path}, fmt::format("{} x {} pixels are too many for PNG; write .exr", width, height));
  }
}

void require_image_writable(const std::string& path) {
  format_of(path);
  require_writable(path);
}

namespace {

void decode_by_module(const std::string& path, DecodedImage& read) {
  static ImageDecoder* const decode =
      reinterpret_cast<ImageDecoder*>(module_function(k_image_decoder_module, k_image_decoder_function));
  try {
    decode(path, read);
  } catch (const std::runtime_error& error) {
    throw Error({path}, std::string("cannot be read as an image: ") + error.what());
  } catch (const std::exception& error) {
    throw Error({path}, std::string("cannot be read as an image: it is damaged or needs too much memory (") +
                            error.what() + ")");
  }
}

}  // namespace

Image read_image(const std::string& path, const ImageReadOptions& options) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) throw Error({path}, "no such file; check the name");
  if (is_folder(path)) throw Error({path}, "it is a folder; name an image file");
  require_regular_file(path);
  DecodedImage read;
  if (!read_plain_image(path, read)) decode_by_module(path, read);
  if (options.metadata) *options.metadata = std::move(read.metadata);
  Image& image = read.image;
  if (read.is_integer && options.linearise) {
    for (size_t i = 0; i < image.data.size(); ++i) {
      if (image.channels[i % image.channel_count()] != "A") image.data[i] = srgb_decode(image.data[i]);
    }
  }
  return std::move(image);
}

}  // namespace fieldtrace
