#include "core/image/image.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {

int Image::channel_index(const std::string& name) const {
  const auto found = std::find(channels.begin(), channels.end(), name);
  return found == channels.end() ? -1 : int(found - channels.begin());
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
