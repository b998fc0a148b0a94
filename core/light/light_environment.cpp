#include "core/light/light_environment.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/platform/error.h"
#include "core/sampling/warp.hd.h"

namespace fieldtrace {
namespace {

constexpr double k_double_pi = 3.14159265358979323846;

// Luminance of linear sRGB (IEC 61966-2-1).
constexpr double k_luminance[3] = {0.2126, 0.7152, 0.0722};

void check_size(const Bitmap& map) {
  const bool good = map.width >= k_least_environment_width && map.height >= k_least_environment_height &&
                    size_t(map.width) * size_t(map.height) <= k_most_environment_texels;
  if (good) return;
  throw Error("the environment map has " + std::to_string(map.width) + " x " + std::to_string(map.height) +
              " pixels; it must have at least " + std::to_string(k_least_environment_width) + " x " +
              std::to_string(k_least_environment_height) + " and at most " + std::to_string(k_most_environment_texels));
}

// Copies the pixels, divided by the power of two that brings the largest value into [1/2, 1): luminances stay in range
// whatever the map's unit. Returns the exponent; 0 for a black map.
int copy_texels(const Bitmap& map, std::vector<float>& texels) {
  float largest = 0.0f;
  for (const Rgb& p : map.pixels) largest = std::max({largest, p.x, p.y, p.z});
  int exponent = 0;
  std::frexp(largest, &exponent);
  texels.clear();
  texels.reserve(map.pixels.size() * 3);
  for (const Rgb& p : map.pixels) {
    for (int c = 0; c < 3; ++c) texels.push_back(std::ldexp(std::max(p[c], 0.0f), -exponent));
  }
  return exponent;
}

// Where a direction falls in the map: the surrounding texels and the interpolation weights.
struct MapPlace {
  int column, next_column, row;
  float s, theta;  // in [0, 1], along phi and theta
  float t;         // likewise along cos theta
};

MapPlace place_in_map(const EnvironmentTable& table, const Light& light, const Vec3& direction) {
  const auto axis = [&](int i) { return Vec3(light.axis[i][0], light.axis[i][1], light.axis[i][2]); };
  const Vec3 unit = glm::normalize(direction);
  const float x = glm::dot(axis(0), unit), y = glm::dot(axis(1), unit), z = glm::dot(axis(2), unit);
  const int width = int(light.width), height = int(light.height);
  MapPlace p;
  const float angle = scalar::angle_upper<float>(std::fabs(x), -z) * scalar::Angle::k_inv_two_pi;
  float u = (x < 0.0f ? 1.0f - angle : angle) * float(width) - 0.5f;
  if (u < 0.0f) u += float(width);
  p.column = std::min(int(u), width - 1);
  p.next_column = p.column + 1 < width ? p.column + 1 : 0;
  p.s = std::min(u - float(p.column), 1.0f);

  const float square = x * x + z * z;
  const float v = scalar::angle_upper<float>(std::sqrt(square), y) * (float(height - 1) * scalar::Angle::k_inv_pi);
  p.row = std::min(int(v), height - 2);
  p.theta = std::min(v - float(p.row), 1.0f);
  // Measured from the nearer pole, where 1 -+ cos theta does not cancel.
  const EnvironmentRow &above = table.rows[size_t(p.row)], &below = table.rows[size_t(p.row) + 1];
  const float t = y >= 0.0f ? (square / (1.0f + y) - above.north) / above.delta
                            : 1.0f - (square / (1.0f - y) - below.south) / above.delta;
  p.t = std::clamp(t, 0.0f, 1.0f);
  return p;
}

// Bilinear interpolation of the texels around `p`, with weight `t` between the rows.
Rgb interpolate(const EnvironmentTable& table, const Light& light, const MapPlace& p, float t) {
  const auto texel = [&](int row, int column) {
    const float* c = &table.texels[(size_t(row) * light.width + size_t(column)) * 3];
    return Rgb(c[0], c[1], c[2]);
  };
  const Rgb above = texel(p.row, p.column) * (1.0f - p.s) + texel(p.row, p.next_column) * p.s;
  const Rgb below = texel(p.row + 1, p.column) * (1.0f - p.s) + texel(p.row + 1, p.next_column) * p.s;
  return above * (1.0f - t) + below * t;
}

}  // namespace

void make_environment(const Bitmap& map, const Mat3& rotation, EnvironmentTable& table, Light& light) {
  check_size(map);
  const size_t width = size_t(map.width), height = size_t(map.height);
  light.width = uint32_t(width);
  light.height = uint32_t(height);
  for (int i = 0; i < 3; ++i) {
    for (int c = 0; c < 3; ++c) light.axis[i][c] = rotation[i][c];
  }
  const int exponent = copy_texels(map, table.texels);
  const auto luminance = [&](size_t row, size_t column) {
    const float* c = &table.texels[(row * width + column) * 3];
    return k_luminance[0] * double(c[0]) + k_luminance[1] * double(c[1]) + k_luminance[2] * double(c[2]);
  };

  // Running sums of luminance; their total normalises the density.
  std::vector<double> row_sums(height);
  table.sums.resize((width + 1) * height);
  table.rows.assign(height, EnvironmentRow{});
  std::vector<double> strips(height, 0.0);  // extent of cos theta from each row to the next
  const double step = k_double_pi / double(height - 1);
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) row_sums[y] += luminance(y, x);
    const double half = 0.5 * double(y) * step;
    table.rows[y].north = float(2.0 * std::sin(half) * std::sin(half));
    table.rows[y].south = float(2.0 * std::sin(0.5 * k_double_pi - half) * std::sin(0.5 * k_double_pi - half));
    if (y + 1 < height) strips[y] = 2.0 * std::sin(0.5 * step) * std::sin(2.0 * half + 0.5 * step);
    table.rows[y].delta = float(strips[y]);
  }
  const double column_angle = 2.0 * k_double_pi / double(width);
  std::vector<double> below(height, 0.0);  // integrals of luminance over the strips
  double total = 0.0;
  for (size_t y = 0; y + 1 < height; ++y) {
    below[y] = column_angle * strips[y] * 0.5 * (row_sums[y] + row_sums[y + 1]);
    total += below[y];
  }
  if (!(total > 0.0)) {
    for (float& v : light.value) v = 0.0f;
    return;
  }
  for (float& v : light.value) v = std::ldexp(v, exponent);
  for (int c = 0; c < 3; ++c) light.luminance[c] = float(k_luminance[c] / total);

  double start = 0.0;
  for (size_t y = 0; y < height; ++y) {
    EnvironmentRow& row = table.rows[y];
    row.start = float(start / total);
    start += below[y];
    if (y + 1 < height) row.scale = float(1.0 / (column_angle * strips[y]));
    double sum = 0.0;
    for (size_t x = 0; x < width; ++x) {
      table.sums[y * (width + 1) + x] = float(sum / total);
      sum += 0.5 * (luminance(y, x) + luminance(y, x + 1 < width ? x + 1 : 0));
    }
    row.sum = table.sums[y * (width + 1) + width] = float(sum / total);
  }
}

Rgb environment_radiance(const EnvironmentTable& table, const Light& light, const Vec3& direction) {
  const MapPlace p = place_in_map(table, light, direction);
  return interpolate(table, light, p, p.theta);
}

float environment_density(const EnvironmentTable& table, const Light& light, const Vec3& direction) {
  const MapPlace p = place_in_map(table, light, direction);
  return glm::dot(Vec3(light.luminance[0], light.luminance[1], light.luminance[2]), interpolate(table, light, p, p.t));
}

}  // namespace fieldtrace
