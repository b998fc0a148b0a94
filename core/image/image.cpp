#include "core/image/image.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {

int Image::channel_index(const std::string& name) const {
  const auto found = std::find(channels.begin(), channels.end(), name);
  return found == channels.end() ? -1 : int(found - channels.begin());
}

std::optional<std::array<int, 3>> colour_channels(const Image& image) {
  const std::array found = {image.channel_index("R"), image.channel_index("G"), image.channel_index("B")};
  return std::count(found.begin(), found.end(), -1) == 0 ? std::optional(found) : std::nullopt;
}

Image select_channels(const Image& image, std::span<const size_t> channels) {
  Image selected{image.width, image.height, {}, {}};
  for (const size_t c : channels) selected.channels.push_back(image.channels[c]);
  selected.data.reserve(size_t(image.width) * size_t(image.height) * channels.size());
  for (size_t i = 0; i < image.data.size(); i += image.channel_count()) {
    for (const size_t c : channels) selected.data.push_back(image.data[i + c]);
  }
  return selected;
}

float srgb_encode(float linear) {
  if (!(linear > 0.0f)) return 0.0f;  // NaN too
  if (linear >= 1.0f) return 1.0f;
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.0f / 2.4f) - 0.055f;
}

float srgb_decode(float encoded) {
  return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f);
}

}  // namespace fieldtrace
