#include "tools/thesis/picture.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "core/image/image.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

std::string base64(const std::string& bytes) {
  static constexpr char k_letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const size_t left = std::min<size_t>(3, bytes.size() - i);
    uint32_t word = 0;
    for (size_t k = 0; k < 3; ++k) word = word << 8 | (k < left ? uint8_t(bytes[i + k]) : 0u);
    for (size_t k = 0; k < 4; ++k) text += k <= left ? k_letters[word >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

// A file that is removed with its owner.
struct ScratchFile {
  std::string path;
  ~ScratchFile() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
};

}  // namespace

double rms_255(const PhongPicture& a, const PhongPicture& b) {
  double sum = 0.0;
  for (size_t i = 0; i < a.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const double d = double(std::lround(255.0f * a.pixels[i][c])) - double(std::lround(255.0f * b.pixels[i][c]));
      sum += d * d;
    }
  }
  return std::sqrt(sum / (3.0 * double(std::max<size_t>(a.pixels.size(), 1))));
}

PhongPicture blurred(const PhongPicture& picture) {
  std::array<float, 5> weights;
  float total = 0.0f;
  for (int k = -2; k <= 2; ++k) total += weights[size_t(k + 2)] = std::exp(-0.5f * float(k * k));
  for (float& w : weights) w /= total;
  const auto pass = [&](const PhongPicture& from, int dx, int dy) {
    PhongPicture to = from;
    for (int y = 0; y < from.size; ++y) {
      for (int x = 0; x < from.size; ++x) {
        Rgb sum(0.0f);
        for (int k = -2; k <= 2; ++k) {
          const int sx = std::clamp(x + k * dx, 0, from.size - 1), sy = std::clamp(y + k * dy, 0, from.size - 1);
          sum += weights[size_t(k + 2)] * from.pixels[size_t(sy) * size_t(from.size) + size_t(sx)];
        }
        to.pixels[size_t(y) * size_t(from.size) + size_t(x)] = sum;
      }
    }
    return to;
  };
  return pass(pass(picture, 1, 0), 0, 1);
}

PhongPicture difference(const PhongPicture& a, const PhongPicture& b, float gain) {
  PhongPicture d = a;
  for (size_t i = 0; i < d.pixels.size(); ++i) {
    d.pixels[i] = glm::clamp(glm::abs(a.pixels[i] - b.pixels[i]) * gain, 0.0f, 1.0f);
  }
  return d;
}

std::string png_data_uri(const PhongPicture& picture, const std::string& scratch_folder) {
  Image image;
  image.width = image.height = picture.size;
  image.channels = {"R", "G", "B"};
  image.data.reserve(3 * picture.pixels.size());
  for (const Rgb& p : picture.pixels) {
    // The writer takes linear values; these are display values.
    for (int c = 0; c < 3; ++c) image.data.push_back(srgb_decode(p[c]));
  }
  const ScratchFile file{
      (std::filesystem::path(scratch_folder) / (".picture-" + std::to_string(getpid()) + ".png")).string()};
  write_image(file.path, image);
  std::ifstream in(file.path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  if (bytes.empty()) throw Error({file.path}, "cannot be read back");
  return "data:image/png;base64," + base64(bytes);
}

}  // namespace fieldtrace
