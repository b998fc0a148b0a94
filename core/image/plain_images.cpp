#include "core/image/plain_images.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace fieldtrace {
namespace {

using File = std::unique_ptr<std::FILE, decltype([](std::FILE* file) { std::fclose(file); })>;
using Signature = std::array<unsigned char, 4>;

constexpr Signature k_exr_signature = {0x76, 0x2f, 0x31, 0x01};

Signature signature_of(std::FILE* file) {
  Signature bytes = {};
  if (std::fread(bytes.data(), 1, bytes.size(), file) != bytes.size()) bytes = {};
  std::rewind(file);
  return bytes;
}

bool fits(double width, double height, size_t channels, double most_values_per_byte, const std::string& path) {
  const double values = width * height * double(channels);
  return width >= 1 && height >= 1 && values <= double(k_most_image_values) &&
         values <= most_values_per_byte * double(std::filesystem::file_size(path));
}

// Of a picture without layers, in OpenImageIO's order; none where there are others.
std::optional<std::vector<std::string>> plain_channels(const Imf::ChannelList& list) {
  std::vector<std::string> names;
  for (const char* name : {"R", "G", "B", "Y", "A"}) {
    const Imf::Channel* const channel = list.findChannel(name);
    if (!channel) continue;
    if (channel->type == Imf::UINT || channel->xSampling != 1 || channel->ySampling != 1) return std::nullopt;
    names.emplace_back(name);
  }
  size_t all = 0;
  for (auto channel = list.begin(); channel != list.end(); ++channel) ++all;
  return names.empty() || names.size() != all ? std::nullopt : std::optional(std::move(names));
}

bool read_exr(const std::string& path, DecodedImage& result) {
  Imf::MultiPartInputFile file(path.c_str(), int(std::thread::hardware_concurrency()));
  if (file.parts() != 1 || !file.partComplete(0)) return false;
  const Imf::Header& header = file.header(0);
  if (header.hasType() && header.type() != Imf::SCANLINEIMAGE && header.type() != Imf::TILEDIMAGE) return false;
  const auto names = plain_channels(header.channels());
  if (!names) return false;
  const Imath::Box2i window = header.dataWindow();
  const int64_t width = int64_t(window.max.x) - window.min.x + 1, height = int64_t(window.max.y) - window.min.y + 1;
  if (!fits(double(width), double(height), names->size(), k_exr_values_per_byte, path)) return false;

  DecodedImage read;
  Image& image = read.image;
  image.width = int(width), image.height = int(height), image.channels = *names;
  image.data.resize(size_t(width) * size_t(height) * names->size());
  const size_t pixel = names->size() * sizeof(float);
  Imf::FrameBuffer frame;
  for (size_t c = 0; c < names->size(); ++c) {
    frame.insert((*names)[c],
                 Imf::Slice::Make(Imf::FLOAT, image.data.data() + c, window, pixel, pixel * size_t(width)));
  }
  Imf::InputPart part(file, 0);
  part.setFrameBuffer(frame);
  part.readPixels(window.min.y, window.max.y);
  for (auto attribute = header.begin(); attribute != header.end(); ++attribute) {
    const auto* const text = dynamic_cast<const Imf::StringAttribute*>(&attribute.attribute());
    if (text) read.metadata[attribute.name()] = text->value();
  }
  result = std::move(read);
  return true;
}

using Pixel = std::array<uint8_t, 4>;  // red, green, blue and their exponent

// The bytes of a file, one after another.
class Bytes {
 public:
  explicit Bytes(std::FILE* file) : file_(file) {}
  // Anything past the end.
  uint8_t next() {
    if (at_ == buffer_.size()) fill();
    return buffer_[at_++];
  }
  std::string line() {
    std::string text;
    while (!ended_ && text.size() < k_longest_line) {
      const char c = char(next());
      if (c == '\n') break;
      text += c;
    }
    return ended_ ? std::string() : text;
  }
  bool ended() const { return ended_; }  // more was asked for than there is

 private:
  static constexpr size_t k_longest_line = 1024, k_block = 65536;

  void fill() {
    buffer_.resize(k_block);
    buffer_.resize(std::fread(buffer_.data(), 1, k_block, file_));
    at_ = 0;
    if (!buffer_.empty()) return;
    ended_ = true;
    buffer_.assign(1, 0);
  }

  std::FILE* file_;
  std::vector<uint8_t> buffer_;
  size_t at_ = 0;
  bool ended_ = false;
};

// A component of a row: runs of up to 127, and stretches without any. False where they do not end with the row.
bool read_runs(Bytes& bytes, size_t component, std::vector<Pixel>& row) {
  constexpr size_t k_run = 128;
  for (size_t x = 0; x < row.size();) {
    const size_t code = bytes.next(), count = code > k_run ? code - k_run : code;
    if (count == 0 || count > row.size() - x) return false;
    if (code > k_run) {
      const uint8_t value = bytes.next();
      for (size_t i = 0; i < count; ++i) row[x++][component] = value;
    } else {
      for (size_t i = 0; i < count; ++i) row[x++][component] = bytes.next();
    }
  }
  return true;
}

// False where pixels are missing, or coded in runs of the format's first version.
bool read_row(Bytes& bytes, std::vector<Pixel>& row) {
  constexpr size_t k_narrowest = 8, k_widest = 0x7fff;  // of rows that are coded in runs by component
  const auto next_pixel = [&] { return Pixel{bytes.next(), bytes.next(), bytes.next(), bytes.next()}; };
  for (size_t x = 0; x < row.size(); ++x) {
    row[x] = next_pixel();
    if (x == 0 && row.size() >= k_narrowest && row.size() <= k_widest && row[0][0] == 2 && row[0][1] == 2 &&
        row[0][2] < 0x80) {
      if ((size_t(row[0][2]) << 8 | row[0][3]) != row.size()) return false;
      for (size_t component = 0; component < 4; ++component) {
        if (!read_runs(bytes, component, row)) return false;
      }
      break;
    }
    if (row[x][0] == 1 && row[x][1] == 1 && row[x][2] == 1) return false;
  }
  return !bytes.ended();
}

// Radiance's pictures (G. Ward, "Real Pixels", Graphics Gems II, 1991), rows from the top, left to right.
bool read_hdr(const std::string& path, std::FILE* file, DecodedImage& result) {
  constexpr size_t k_channels = 3;
  Bytes bytes(file);
  bool is_rgbe = false;
  for (std::string line = bytes.line(); !line.empty(); line = bytes.line())
    is_rgbe = is_rgbe || line == "FORMAT=32-bit_rle_rgbe";
  if (!is_rgbe) return false;
  int width = 0, height = 0, end = 0;
  const std::string size = bytes.line();
  if (std::sscanf(size.c_str(), "-Y %d +X %d%n", &height, &width, &end) != 2 || size_t(end) != size.size())
    return false;
  if (!fits(width, height, k_channels, k_hdr_values_per_byte, path)) return false;
  Image image;
  image.width = width, image.height = height, image.channels = {"R", "G", "B"};
  image.data.reserve(size_t(width) * size_t(height) * k_channels);
  std::vector<Pixel> row(static_cast<size_t>(width));
  for (int y = 0; y < height; ++y) {
    if (!read_row(bytes, row)) return false;
    for (const Pixel& pixel : row) {
      const float scale = pixel[3] == 0 ? 0.0f : std::ldexp(1.0f, int(pixel[3]) - (128 + 8));
      for (size_t c = 0; c < k_channels; ++c) image.data.push_back(float(pixel[c]) * scale);
    }
  }
  result = {};
  result.image = std::move(image);
  return true;
}

}  // namespace

bool read_plain_image(const std::string& path, DecodedImage& result) {
  const File file(std::fopen(path.c_str(), "rb"));
  if (!file) return false;
  const Signature signature = signature_of(file.get());
  try {
    if (signature == k_exr_signature) return read_exr(path, result);
    if (signature[0] == '#' && signature[1] == '?') return read_hdr(path, file.get(), result);
  } catch (const std::exception&) {  // OpenImageIO says it better
  }
  return false;
}

}  // namespace fieldtrace
