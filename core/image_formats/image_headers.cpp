#include "core/image_formats/image_headers.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <vector>

#include "core/image/image_decoder.h"

namespace fieldtrace {
namespace {

constexpr double k_unbounded = std::numeric_limits<double>::infinity();

// A GIF's canvas may be larger than its first frame, and what lies around that costs no bytes. This many values, of
// 8192 x 8192 pixels, are 1 GiB.
constexpr double k_most_canvas_values = 0x1p28;

// The most bytes that one byte of a TIFF can encode.
double most_tiff_bytes_per_byte(const std::string& compression) {
  if (compression == "none") return 1;
  if (compression == "packbits") return 64;  // runs of 128 in 2 bytes
  // Deflate (RFC 1951) encodes a run of 258 bytes in 2 bits, one for the length and one for the distance.
  if (compression == "zip") return 1032;
  // Strings of up to 2^n bytes, the most that a table of 2^n has, in n = 9 to 12 bits.
  if (compression == "lzw") return 4096 * 8 / 12.0;
  return k_unbounded;
}

// The most values (every channel of every pixel counted) that one byte of a file can encode, by OpenImageIO's name of
// the format. Each is the best case of the format's compression; infinity where that has no bound (a WebP image of one
// colour is a few bytes at any size).
double most_values_per_byte(const std::string& format, const OIIO::ImageSpec& spec) {
  // 8 pixels of a palette of two colours with alpha: 4 channels each.
  constexpr double k_uncompressed = 32;
  constexpr double k_deflate = 1032;
  if (format == "pnm") return 8;  // 1-bit grey; never compressed
  if (format == "hdr") return k_hdr_values_per_byte;
  if (format == "targa") return 256;  // runs of 128 pixels in 2 bytes, through a palette with alpha
  if (format == "gif") return 10924;  // LZW: 12 bits for strings of at most 2^12 pixels, 4 channels each
  if (format == "png") return k_deflate * k_uncompressed;
  if (format == "openexr") return k_exr_values_per_byte;
  const std::string compression = spec.get_string_attribute("compression");
  // OpenImageIO reports a BMP's compression only if it has one.
  if (format == "bmp" && (compression.empty() || compression == "none")) return k_uncompressed;
  if (format != "tiff") return k_unbounded;
  // A fax code for a whole row takes at least one bit.
  if (compression.starts_with("ccitt")) return 8.0 * spec.width * spec.nchannels;
  // 32 x 32 pixels of 4 channels, of components sampled 4 x 1, 1 x 4 and 1 x 1 times: 9 blocks of a bit or more each.
  if (compression == "jpeg") return 32 * 32 * 4 * 8 / 9.0;
  return most_tiff_bytes_per_byte(compression) * k_uncompressed;
}

[[noreturn]] void fail_of_size(double width, double height, uint64_t bytes) {
  throw Failure("its header tells of " + std::to_string(int64_t(width)) + " x " + std::to_string(int64_t(height)) +
                " pixels, more than its " + std::to_string(bytes) + " bytes can hold; the file is cut off or damaged");
}

// Bytes of a file, one after another; zeros after its end.
class Bytes {
 public:
  explicit Bytes(const std::string& path) : file_(path, std::ios::binary) {}
  unsigned next() {
    const int c = file_.get();
    return c == std::char_traits<char>::eof() ? 0 : unsigned(c);
  }
  unsigned little() {
    const unsigned low = next();
    return low | next() << 8;
  }
  unsigned big() {
    const unsigned high = next();
    return high << 8 | next();
  }
  void skip(unsigned n) { file_.ignore(n); }
  bool good() const { return file_.good(); }

 private:
  std::ifstream file_;
};

// After "GIF8".
void check_gif(Bytes& in, uint64_t bytes) {
  constexpr double k_channels = 4;
  constexpr unsigned k_extension = 0x21, k_image = 0x2c, k_has_palette = 0x80;
  const double most = most_values_per_byte("gif", {}) * double(bytes);
  in.skip(2);
  const double width = in.little(), height = in.little();
  const unsigned flags = in.next();
  in.skip(2);
  if (flags & k_has_palette) in.skip(3u << ((flags & 7) + 1));
  unsigned block = in.next();
  while (block == k_extension) {
    in.skip(1);
    while (const unsigned size = in.next()) in.skip(size);
    block = in.next();
  }
  if (block != k_image) throw Failure("it has no image; the file is cut off or damaged");
  in.skip(4);
  const double frame_width = in.little(), frame_height = in.little();
  if (frame_width * frame_height * k_channels > most) fail_of_size(frame_width, frame_height, bytes);
  if (width * height * k_channels > std::max(most, k_most_canvas_values)) fail_of_size(width, height, bytes);
}

// The least bits of a block of 8 x 8 samples, by the kind of frame (ITU-T T.81, table B.1). A Huffman code has at least
// a bit. A sequential block has at least two, the first coefficient's and the one that ends the block; a progressive
// image has the first coefficients, and may have no others. Arithmetic coding has no such bound.
int least_bits_per_block(unsigned frame_marker) { return frame_marker <= 0xc1 ? 2 : frame_marker == 0xc2 ? 1 : 0; }

// After the start marker. What is not a segment or has no frame header is left to the decoder.
void check_jpeg(Bytes& in, uint64_t bytes) {
  const auto is_frame = [](unsigned m) { return m >= 0xc0 && m <= 0xcf && m != 0xc4 && m != 0xc8 && m != 0xcc; };
  constexpr unsigned k_scan = 0xda;
  unsigned marker = 0;
  while (in.good()) {
    if (in.next() != 0xff) continue;
    do marker = in.next();
    while (marker == 0xff);
    if (marker == k_scan) return;
    if (is_frame(marker)) break;
    if (marker == 0 || marker == 0x01 || (marker >= 0xd0 && marker <= 0xd9)) continue;  // without a length
    const unsigned length = in.big();
    in.skip(std::max(length, 2u) - 2);
  }
  in.skip(3);  // the length and the precision
  const unsigned height = in.big(), width = in.big(), components = in.next();
  std::vector<std::array<unsigned, 2>> sampling;
  std::array<unsigned, 2> most = {1, 1};
  for (unsigned i = 0; i < components && in.good(); ++i) {
    in.skip(1);
    const unsigned factors = in.next();
    in.skip(1);
    sampling.push_back({factors >> 4, factors & 15});
    for (int axis = 0; axis < 2; ++axis) most[axis] = std::max(most[axis], sampling.back()[axis]);
  }
  const auto blocks_along = [](unsigned pixels, unsigned factor, unsigned largest) {
    return (uint64_t(pixels) * factor + 8 * largest - 1) / (8 * largest);
  };
  uint64_t blocks = 0;
  for (const auto& factor : sampling)
    blocks += blocks_along(width, factor[0], most[0]) * blocks_along(height, factor[1], most[1]);
  if (blocks * uint64_t(least_bits_per_block(marker)) > 8 * bytes) fail_of_size(width, height, bytes);
}

}  // namespace

void check_own_header(const std::string& path) {
  const uint64_t bytes = std::filesystem::file_size(path);
  Bytes in(path);
  const unsigned start = in.big();
  if (start == 0xffd8) check_jpeg(in, bytes);
  if (start == ('G' << 8 | 'I') && in.big() == ('F' << 8 | '8')) check_gif(in, bytes);
}

void check_size(const std::string& path, const std::string& format, const OIIO::ImageSpec& spec) {
  if (format == "gif") return;  // by check_own_header()
  const auto bytes = std::filesystem::file_size(path);
  const double values = double(spec.width) * spec.height * spec.nchannels;
  if (values > most_values_per_byte(format, spec) * double(bytes)) fail_of_size(spec.width, spec.height, bytes);
}

}  // namespace fieldtrace
