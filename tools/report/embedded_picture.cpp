#include "tools/report/embedded_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>

#include "core/io/scratch_folder.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

// Of equal steps from 0 to 1.
constexpr std::array<std::array<float, 3>, 6> k_error_colours = {{{0, 0, 0},
                                                                  {0.25f, 0.07f, 0.45f},
                                                                  {0.60f, 0.16f, 0.47f},
                                                                  {0.90f, 0.36f, 0.32f},
                                                                  {0.99f, 0.68f, 0.36f},
                                                                  {1, 1, 0.78f}}};

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

struct Channels {
  std::array<int, 3> rgb;
  explicit Channels(const Image& image) : rgb(colour_channels(image).value()) {}
  Rgb operator()(const Image& image, int x, int y) const {
    const float* p = image.pixel(x, y);
    return Rgb(p[rgb[0]], p[rgb[1]], p[rgb[2]]);
  }
};

// colour(x, y): linear. The whole picture.
template <class Colour>
Image make_picture(int width, int height, const Colour& colour) {
  Image image{width, height, {"R", "G", "B"}, {}};
  image.data.reserve(3 * size_t(width) * size_t(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Rgb c = colour(x, y);
      for (int k = 0; k < 3; ++k) image.data.push_back(c[k]);
    }
  }
  return image;
}

Rgb linear(const Rgb& displayed) {
  return Rgb(srgb_decode(displayed[0]), srgb_decode(displayed[1]), srgb_decode(displayed[2]));
}

Image reduced(const Image& image) {
  const int factor = (std::max(image.width, image.height) + k_most_embedded_side - 1) / k_most_embedded_side;
  const Channels channels(image);
  const int width = (image.width + factor - 1) / factor, height = (image.height + factor - 1) / factor;
  return make_picture(width, height, [&](int x, int y) {
    Rgb sum(0.0f);
    float count = 0.0f;
    for (int sy = y * factor; sy < std::min((y + 1) * factor, image.height); ++sy) {
      for (int sx = x * factor; sx < std::min((x + 1) * factor, image.width); ++sx) {
        sum += channels(image, sx, sy);
        count += 1.0f;
      }
    }
    return sum / count;
  });
}

}  // namespace

std::string png_data_uri(const Image& image, const std::string& scratch_folder) {
  const ScratchFolder scratch(scratch_folder, "picture");
  const std::string path = scratch.path() + "/picture.png";
  write_image(path, reduced(image));
  std::ifstream in(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  if (bytes.empty()) throw Error({path}, "cannot be read back");
  return "data:image/png;base64," + base64(bytes);
}

Image difference_picture(const Image& a, const Image& b, double gain) {
  const Channels ca(a), cb(b);
  return make_picture(a.width, a.height,
                      [&](int x, int y) { return glm::abs(ca(a, x, y) - cb(b, x, y)) * float(gain); });
}

double difference_gain(const std::vector<const Image*>& images, const Image& reference) {
  std::vector<float> values;
  const Channels cr(reference);
  for (const Image* image : images) {
    const Channels ci(*image);
    for (int y = 0; y < reference.height; ++y) {
      for (int x = 0; x < reference.width; ++x) {
        const Rgb d = glm::abs(ci(*image, x, y) - cr(reference, x, y));
        const float most = std::max({d[0], d[1], d[2]});
        if (std::isfinite(most)) values.push_back(most);
      }
    }
  }
  if (values.empty()) return 1.0;
  const auto at = values.begin() + std::ptrdiff_t((values.size() - 1) * 99 / 100);
  std::nth_element(values.begin(), at, values.end());
  // Nothing is shown more than a million times as strong: that would be rounding.
  if (!(*at > 1e-6f)) return 1.0;
  return std::max(1.0, std::exp2(std::floor(-std::log2(double(*at)))));
}

Rgb error_colour(float error) {
  const float at = std::clamp(error, 0.0f, 1.0f) * float(k_error_colours.size() - 1);
  const size_t i = std::min(size_t(at), k_error_colours.size() - 2);
  const auto colour = [&](size_t k) {
    return Rgb(k_error_colours[k][0], k_error_colours[k][1], k_error_colours[k][2]);
  };
  return glm::mix(colour(i), colour(i + 1), at - float(i));
}

Image error_picture(const std::vector<float>& errors, int width, int height) {
  return make_picture(
      width, height, [&](int x, int y) { return linear(error_colour(errors[size_t(y) * size_t(width) + size_t(x)])); });
}

Rgb nearer_first_colour() { return Rgb(0.14f, 0.44f, 0.64f); }
Rgb nearer_second_colour() { return Rgb(0.93f, 0.55f, 0.16f); }

NearerMap nearer_map(const Image& first, const Image& second, const Image& reference) {
  const Channels ca(first), cb(second), cr(reference);
  NearerMap map;
  map.picture = make_picture(reference.width, reference.height, [&](int x, int y) {
    const Rgb truth = cr(reference, x, y), da = ca(first, x, y) - truth, db = cb(second, x, y) - truth;
    const float a = glm::dot(da, da), b = glm::dot(db, db);
    (a < b ? map.first : b < a ? map.second : map.both) += 1.0;
    return linear(a < b ? nearer_first_colour() : b < a ? nearer_second_colour() : Rgb(0.8f));
  });
  const double pixels = map.first + map.second + map.both;
  if (pixels > 0.0) map.first /= pixels, map.second /= pixels, map.both /= pixels;
  return map;
}

std::string error_scale() {
  constexpr int k_steps = 40, k_step = 6;
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {0} 34\" width=\"{0}\" height=\"34\" role=\"img\" font-family=\"sans-serif\" "
      "font-size=\"11\">\n",
      k_steps * k_step + 20);
  for (int i = 0; i < k_steps; ++i) {
    const Rgb c = 255.0f * error_colour((float(i) + 0.5f) / float(k_steps));
    svg += fmt::format("<rect x=\"{}\" y=\"2\" width=\"{}\" height=\"14\" fill=\"#{:02x}{:02x}{:02x}\"/>",
                       10 + i * k_step, k_step, int(c[0] + 0.5f), int(c[1] + 0.5f), int(c[2] + 0.5f));
  }
  for (const double v : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    svg += fmt::format("<text x=\"{:g}\" y=\"30\" text-anchor=\"middle\">{:g}</text>", 10 + v * k_steps * k_step, v);
  }
  return svg + "</svg>\n";
}

}  // namespace fieldtrace
