#include "core/material/texture.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Coordinates are kept in this range, so that texel indices fit an int.
constexpr float k_largest_coordinate = 0x1p20f;

// By whole periods of all patterns, which is exact, unless the edge goes on without end.
float sanitise(float x, bool repeats) {
  if (!std::isfinite(x)) return 0.0f;
  if (repeats && std::abs(x) > k_largest_coordinate) return x - 2.0f * std::floor(0.5f * x);
  return std::clamp(x, -k_largest_coordinate, k_largest_coordinate);
}

// Maps any texel index to [0, n).
int wrap_index(int64_t i, int n, WrapMode mode) {
  if (mode == WrapMode::clamp) return int(std::clamp<int64_t>(i, 0, n - 1));
  const int64_t period = mode == WrapMode::mirror ? 2 * int64_t(n) : n;
  int64_t r = i % period;
  if (r < 0) r += period;
  return int(r < n ? r : period - 1 - r);
}

Rgb lookup_bitmap(const Bitmap& bitmap, const Texture& texture, const Vec2& uv) {
  const auto texel = [&](int64_t x, int64_t y) {
    const int column = wrap_index(x, bitmap.width, texture.wrap);
    const int row = wrap_index(y, bitmap.height, texture.wrap);
    return bitmap.pixels[size_t(row) * bitmap.width + column];
  };
  // Double, because large coordinates times large images would lose the fraction in float.
  const double x = double(uv.x) * bitmap.width, y = double(uv.y) * bitmap.height;
  if (texture.filter == TextureFilter::nearest) return texel(int64_t(std::floor(x)), int64_t(std::floor(y)));
  const double x0 = std::floor(x - 0.5), y0 = std::floor(y - 0.5);
  const float fx = float(x - 0.5 - x0), fy = float(y - 0.5 - y0);
  const auto i = int64_t(x0), j = int64_t(y0);
  return (1.0f - fy) * ((1.0f - fx) * texel(i, j) + fx * texel(i + 1, j)) +
         fy * ((1.0f - fx) * texel(i, j + 1) + fx * texel(i + 1, j + 1));
}

Vec2 place_on(const Texture& texture, const Vec2& uv) {
  const Vec2 p = texture.uv_transform * Vec3(uv, 1.0f);
  const bool repeats = texture.kind == TextureKind::checkerboard || texture.wrap != WrapMode::clamp;
  return {sanitise(p.x, repeats), sanitise(p.y, repeats)};
}

// Whether p lies on the checkerboard's square at the origin or on one connected to it by corners.
bool on_first_squares(const Vec2& p) {
  const bool right = p.x - std::floor(p.x) > 0.5f, upper = p.y - std::floor(p.y) > 0.5f;
  return right == upper;
}

}  // namespace

Rgb evaluate_texture(const Scene& scene, uint32_t index, const Vec2& uv) {
  const Texture& texture = scene.textures[index];
  if (texture.kind == TextureKind::constant) return texture.color0;
  const Vec2 p = place_on(texture, uv);
  if (texture.kind == TextureKind::checkerboard) return on_first_squares(p) ? texture.color0 : texture.color1;
  return lookup_bitmap(scene.bitmaps[texture.bitmap], texture, p);
}

float evaluate_scalar_texture(const Scene& scene, uint32_t index, const Vec2& uv) {
  const Texture& texture = scene.textures[index];
  if (texture.kind == TextureKind::bitmap) {
    return glm::dot(evaluate_texture(scene, index, uv), Rgb(0.212671f, 0.715160f, 0.072169f));  // ITU-R BT.709
  }
  const bool is_second = texture.kind == TextureKind::checkerboard && on_first_squares(place_on(texture, uv));
  const Rgb value = is_second ? texture.color1 : texture.color0;
  return (value.x + value.y + value.z) / 3.0f;
}

}  // namespace fieldtrace
