#include "hybrid/sky/sky_radiance.h"

#include <algorithm>
#include <cmath>

#include "core/platform/parallel.h"
#include "core/simd/vec_lanes.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_visibility.hd.h"

namespace fieldtrace {
namespace {

constexpr int k_fine_cells = 128;      // along each side of the fine grid
constexpr int k_table_cells = 64;      // of the irradiance by normal, and of the cells that it is summed over
constexpr double k_fine_samples = 16;  // of a map in each fine cell, in the mean
constexpr size_t k_bands = 16;         // of a map's rows: sums are those of the bands in order, whatever the threads
// What is cut out covers less of the sphere than this, and carries more of the map's power than that.
constexpr double k_concentrated_share = 1.0 / 500.0, k_concentrated_power = 0.05;

float luminance(const Rgb& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }
Rgb positive(const Rgb& c) { return glm::max(c, Rgb(0.0f)); }

float cell_half_width(int directions) { return std::sqrt(k_pi) / float(directions); }

int cell_index(const Vec3& d, int n) {
  scalar::CellAddress<float> cell;
  scalar::find_direction_cell(lanes(d), make_axis(n), cell);
  return cell.u * n + cell.v;
}

// Point (x, y) of cell `i` of an n x n grid, x and y in [0, 1].
Vec3 direction_in(int i, int n, float x, float y) {
  const float step = 2.0f / float(n);
  return to_vec(scalar::frame_from_square<float>((float(i / n) + x) * step - 1.0f, (float(i % n) + y) * step - 1.0f).c);
}

// The luminance above which a map's light counts as concentrated; infinite if it has no such source. By a histogram
// over powers of two to the eighth.
float concentration_threshold(const Bitmap& map) {
  constexpr int k_bins = 2048;
  std::vector<double> area(k_bins, 0.0), power(k_bins, 0.0);
  const auto bin_of = [](float y) { return std::clamp(int(8.0f * std::log2(y)) + k_bins / 2, 0, k_bins - 1); };
  double all_area = 0.0, all_power = 0.0;
  for (int y = 0; y < map.height; ++y) {
    const double sine = std::sin(double(k_pi) * double(y) / double(map.height - 1));
    for (int x = 0; x < map.width; ++x) {
      const float light = luminance(positive(map.pixels[size_t(y) * size_t(map.width) + size_t(x)]));
      all_area += sine;
      if (!(light > 0.0f)) continue;
      area[size_t(bin_of(light))] += sine;
      power[size_t(bin_of(light))] += sine * double(light);
      all_power += sine * double(light);
    }
  }
  double above_area = 0.0, above_power = 0.0;
  for (int bin = k_bins - 1; bin > 0; --bin) {
    above_area += area[size_t(bin)];
    above_power += power[size_t(bin)];
    if (above_area + area[size_t(bin) - 1] <= k_concentrated_share * all_area) continue;
    const float threshold = std::exp2(float(bin - k_bins / 2) / 8.0f);
    const bool is_concentrated = above_power - double(threshold) * above_area > k_concentrated_power * all_power;
    return is_concentrated ? threshold : k_infinity;
  }
  return all_power > 0.0 ? 0.0f : k_infinity;  // lights on black alone
}

// The direction of place (x, y) of a map, whose texels lie at whole numbers (core/light/light_environment.h).
Vec3 map_direction(const Emitter& emitter, const Bitmap& map, float x, float y) {
  const float theta = k_pi * y / float(map.height - 1), phi = 2.0f * k_pi * (x + 0.5f) / float(map.width);
  const float sine = std::sin(theta);
  return emitter.rotation * Vec3(std::sin(phi) * sine, std::cos(theta), -std::cos(phi) * sine);
}

// What is left of a texel.
Rgb rest_of(const Rgb& texel, float threshold) {
  const Rgb c = positive(texel);
  const float y = luminance(c);
  return y > threshold ? c * (threshold / y) : c;
}

}  // namespace

SkyRadiance::SkyRadiance(const Scene& scene) {
  for (const Emitter& e : scene.emitters) {
    if (e.kind == EmitterKind::constant) constant_ += e.value;
    if (e.kind == EmitterKind::environment) add_map(scene, e);
  }
  if (!fine_.empty()) make_table();
}

void SkyRadiance::cut_out(const Bitmap& map, const Emitter& emitter, float threshold) {
  Scene scene;
  Bitmap& upper = scene.bitmaps.emplace_back(map);
  for (Rgb& c : upper.pixels) c = positive(c) - rest_of(c, threshold);
  Emitter& e = scene.emitters.emplace_back(emitter);
  e.bitmap = 0;
  concentrated_ = std::make_unique<LightTable>(make_lights(scene));
  DVec3 sum(0.0);  // squares of large values overflow a float
  const auto direction_of = [&](size_t i) {
    return map_direction(emitter, map, float(i % size_t(map.width)), float(i / size_t(map.width)));
  };
  for (size_t i = 0; i < upper.pixels.size(); ++i) {
    sum += DVec3(direction_of(i)) * double(luminance(upper.pixels[i]));
  }
  if (!(glm::length(sum) > 0.0)) return;
  axis_ = Vec3(glm::normalize(sum));
  float least = 1.0f;
  for (size_t i = 0; i < upper.pixels.size(); ++i) {
    if (luminance(upper.pixels[i]) > 0.0f) least = std::min(least, glm::dot(axis_, direction_of(i)));
  }
  // Between texels the light falls to 0 over one more.
  const float texel = 2.0f * k_pi * (1.0f / float(map.width) + 0.5f / float(map.height - 1));
  angle_ = std::min(std::acos(std::clamp(least, -1.0f, 1.0f)) + texel, k_pi);
}

// Adds samples all over the map to the cells of the fine grid.
void SkyRadiance::add_map(const Scene& scene, const Emitter& emitter) {
  const Bitmap& map = scene.bitmaps[emitter.bitmap];
  const float threshold = concentration_threshold(map);
  if (threshold < k_infinity) cut_out(map, emitter, threshold);
  constexpr size_t k_cells = size_t(k_fine_cells) * size_t(k_fine_cells);
  const double wanted = k_fine_samples * double(k_cells);
  const int finer = std::max(1, int(std::ceil(std::sqrt(wanted / (double(map.width) * double(map.height - 1))))));
  const int rows = (map.height - 1) * finer, columns = map.width * finer;
  struct Sum {
    DVec3 light = DVec3(0.0);
    double area = 0.0;
  };
  std::vector<std::vector<Sum>> bands(k_bands);
  parallel_for(k_bands, [&](size_t band) {
    std::vector<Sum>& sums = bands[band];
    sums.resize(k_cells);
    for (int row = int(size_t(rows) * band / k_bands); row < int(size_t(rows) * (band + 1) / k_bands); ++row) {
      const float y = (float(row) + 0.5f) / float(finer);
      const int above = std::min(int(y), map.height - 2);
      const double sine = std::sin(double(k_pi) * double(y) / double(map.height - 1));
      for (int column = 0; column < columns; ++column) {
        const float x = (float(column) + 0.5f) / float(finer);
        const int left = int(x), right = left + 1 < map.width ? left + 1 : 0;
        const auto texel = [&](int r, int c) {
          return rest_of(map.pixels[size_t(r) * size_t(map.width) + size_t(c)], threshold);
        };
        const float s = x - float(left), t = y - float(above);
        const Rgb light = (texel(above, left) * (1.0f - s) + texel(above, right) * s) * (1.0f - t) +
                          (texel(above + 1, left) * (1.0f - s) + texel(above + 1, right) * s) * t;
        Sum& sum = sums[size_t(cell_index(map_direction(emitter, map, x, y), k_fine_cells))];
        sum.light += DVec3(light) * sine;
        sum.area += sine;
      }
    }
  });
  if (fine_.empty()) {
    fine_.assign(k_cells, Rgb(0.0f));
    for (size_t i = 0; i < k_cells; ++i) fine_direction_.push_back(direction_in(int(i), k_fine_cells, 0.5f, 0.5f));
  }
  for (size_t i = 0; i < k_cells; ++i) {
    Sum all;
    for (const std::vector<Sum>& sums : bands) all.light += sums[i].light, all.area += sums[i].area;
    if (all.area > 0.0) fine_[i] += Rgb(all.light / all.area) * emitter.value;
  }
}

SkyCells SkyRadiance::cells(const Mat3& grid, int directions) const {
  const size_t count = size_t(directions) * size_t(directions);
  SkyCells cells;
  cells.half_width = cell_half_width(directions);
  for (auto* v : {&cells.red, &cells.green, &cells.blue, &cells.vx, &cells.vy, &cells.vz}) v->assign(count, 0.0f);
  std::vector<Rgb> light(count, Rgb(0.0f));
  std::vector<Vec3> direction(count, Vec3(0.0f));
  std::vector<float> weight(count, 0.0f), samples(count, 0.0f);
  const auto add = [&](size_t cell, const Rgb& radiance, const Vec3& d) {
    // A black sky has directions, too.
    const float y = luminance(constant_ + radiance) + 1e-20f;
    light[cell] += radiance;
    direction[cell] += d * y;
    weight[cell] += y;
    samples[cell] += 1.0f;
  };
  if (fine_.empty()) {
    constexpr int k_side = 4;
    for (size_t i = 0; i < count; ++i) {
      for (int k = 0; k < k_side * k_side; ++k) {
        const float x = (float(k / k_side) + 0.5f) / k_side, y = (float(k % k_side) + 0.5f) / k_side;
        add(i, Rgb(0.0f), direction_in(int(i), directions, x, y));
      }
    }
  } else {
    const Mat3 to_grid = glm::transpose(grid);
    for (size_t i = 0; i < fine_.size(); ++i) {
      const Vec3 d = to_grid * fine_direction_[i];
      add(size_t(cell_index(d, directions)), fine_[i], d);
    }
  }
  for (size_t i = 0; i < count; ++i) {
    const Rgb radiance = constant_ + (samples[i] > 0.0f ? light[i] / samples[i] : Rgb(0.0f));
    const Vec3 local = samples[i] > 0.0f ? direction[i] / weight[i] : direction_in(int(i), directions, 0.5f, 0.5f);
    const Vec3 d = grid * local;
    cells.red[i] = radiance.x, cells.green[i] = radiance.y, cells.blue[i] = radiance.z;
    cells.vx[i] = d.x, cells.vy[i] = d.y, cells.vz[i] = d.z;
  }
  return cells;
}

void SkyRadiance::make_table() {
  const SkyCells sky = cells(Mat3(1.0f), k_table_cells);
  const float solid_angle = 4.0f * k_pi / float(k_table_cells * k_table_cells);
  constexpr int k_side = k_table_cells + 1;
  table_.resize(size_t(k_side) * size_t(k_side));
  parallel_for(size_t(k_side), [&](size_t row) {
    for (int column = 0; column < k_side; ++column) {
      const float step = 2.0f / float(k_table_cells);
      const Vec3 n = to_vec(scalar::frame_from_square<float>(float(row) * step - 1.0f, float(column) * step - 1.0f).c);
      float red = 0.0f, green = 0.0f, blue = 0.0f;
      for (size_t i = 0; i < size_t(k_table_cells * k_table_cells); ++i) {
        const float mean = n.x * sky.vx[i] + n.y * sky.vy[i] + n.z * sky.vz[i];
        const float cosine = scalar::cosine_over_cell<float>(mean, sky.half_width);
        red += cosine * sky.red[i], green += cosine * sky.green[i], blue += cosine * sky.blue[i];
      }
      table_[row * size_t(k_side) + size_t(column)] = Rgb(red, green, blue) * solid_angle;
    }
  });
}

Rgb SkyRadiance::irradiance(const Vec3& n) const {
  if (table_.empty()) return constant_ * k_pi;
  float u, v;
  scalar::square_from_direction(lanes(n), u, v);
  const auto place = [](float x) { return std::clamp((x + 1.0f) * 0.5f, 0.0f, 1.0f) * float(k_table_cells); };
  const float x = place(u), y = place(v);
  const int i = std::min(int(x), k_table_cells - 1), j = std::min(int(y), k_table_cells - 1);
  const float s = x - float(i), t = y - float(j);
  const Rgb* const corner = &table_[size_t(i) * size_t(k_table_cells + 1) + size_t(j)];
  const Rgb low = corner[0] * (1.0f - t) + corner[1] * t;
  const Rgb high = corner[k_table_cells + 1] * (1.0f - t) + corner[k_table_cells + 2] * t;
  return low * (1.0f - s) + high * s;
}

}  // namespace fieldtrace
