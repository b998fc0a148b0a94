#include "tools/thesis/picture.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace fieldtrace {
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

Image to_image(const PhongPicture& picture) {
  Image image{picture.size, picture.size, {"R", "G", "B"}, {}};
  image.data.reserve(3 * picture.pixels.size());
  for (const Rgb& p : picture.pixels) {
    for (int c = 0; c < 3; ++c) image.data.push_back(srgb_decode(p[c]));
  }
  return image;
}

}  // namespace fieldtrace
