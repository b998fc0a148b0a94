#include "hybrid/sky/sky_radiance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "core/platform/parallel.h"
#include "core/simd/vec_lanes.h"
#include "core/trace/rays.h"
#include "field/bake/cell_lines.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_kernels.h"

namespace fieldtrace {
namespace {

constexpr int k_fine_cells = 128;      // along each side of the fine grid
constexpr int k_table_cells = 64;      // of the irradiance by normal, and of the cells that it is summed over
constexpr double k_fine_samples = 16;  // of a map in each fine cell, in the mean
constexpr size_t k_bands = 16;         // of a map's rows: sums are those of the bands in order, whatever the threads
// What is cut out carries more of the map's power than this.
constexpr double k_concentrated_power = 0.05;

Rgb positive(const Rgb& c) { return glm::max(c, Rgb(0.0f)); }

// Of an interval whose variance is that of cells along a line, in the mean: most cells are longer than wide.
constexpr float k_cell_stretch = 1.12f;
float cell_half_width(int directions) { return k_cell_stretch * std::sqrt(k_pi) / float(directions); }

// Interpolation of side x side values over the octahedral square, `density` of them per unit, the first at -1 - shift /
// density. It is linear over triangles whose long edges lie along the folds between the hemispheres.
Rgb interpolate(const std::vector<Rgb>& values, int side, const Vec3& d, float density, float shift) {
  float u, v;
  scalar::square_from_direction(lanes(d), u, v);
  const auto place = [&](float x) { return std::clamp((x + 1.0f) * density + shift, 0.0f, float(side - 1)); };
  const float x = place(u), y = place(v);
  const int i = std::min(int(x), side - 2), j = std::min(int(y), side - 2);
  const Rgb* const low = &values[size_t(i) * size_t(side) + size_t(j)];
  const Rgb* const high = low + side;
  const bool rises = (u > 0.0f) != (v > 0.0f);  // the fold, of v over u
  const float s = x - float(i), t = rises ? 1.0f - (y - float(j)) : y - float(j);
  // Nearer than the fold along t, and farther.
  const Rgb &near_low = low[rises], &far_low = low[!rises], &near_high = high[rises], &far_high = high[!rises];
  if (s + t < 1.0f) return near_low + (near_high - near_low) * s + (far_low - near_low) * t;
  return far_high + (far_low - far_high) * (1.0f - s) + (near_high - far_high) * (1.0f - t);
}

// The integral over the sphere of what a texel of row `y` weighs between texels, in units of the width of a column.
double row_weight(int y, int height) {
  const double step = double(k_pi) / double(height - 1);
  if (y == 0 || y == height - 1) return 1.0 - std::sin(step) / step;
  const double half_sine = std::sin(0.5 * step);
  return 4.0 * half_sine * half_sine / step * std::sin(step * double(y));
}

// The luminance above which a map's light counts as concentrated; infinite if it has no such source. By a histogram
// over the leading bits of floats, eight bins for each power of two.
float concentration_threshold(const Bitmap& map, double largest) {
  constexpr int k_dropped_bits = 20;
  constexpr size_t k_bins = size_t(1) << (31 - k_dropped_bits);
  std::vector<double> area(k_bins, 0.0), power(k_bins, 0.0);
  double all_area = 0.0, all_power = 0.0;
  for (int y = 0; y < map.height; ++y) {
    const double weight = row_weight(y, map.height);
    for (int x = 0; x < map.width; ++x) {
      const float light = luminance(positive(map.pixels[size_t(y) * size_t(map.width) + size_t(x)]));
      const size_t bin = std::bit_cast<uint32_t>(light) >> k_dropped_bits;
      area[bin] += weight;
      power[bin] += weight * double(light);
    }
  }
  for (size_t bin = 0; bin < k_bins; ++bin) all_area += area[bin], all_power += power[bin];
  double above_area = 0.0, above_power = 0.0;
  size_t least = k_bins;
  while (least > 0 && above_area + area[least - 1] <= largest * all_area) {
    above_area += area[--least];
    above_power += power[least];
  }
  // Below the first bin that is not black there is nothing.
  const float threshold = least <= 1 ? 0.0f : std::bit_cast<float>(uint32_t(least << k_dropped_bits));
  const bool is_concentrated = above_power - double(threshold) * above_area > k_concentrated_power * all_power;
  return is_concentrated ? threshold : k_infinity;
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

SkyRadiance::SkyRadiance(const Scene& scene, double largest) {
  for (const Emitter& e : scene.emitters) {
    if (e.kind == EmitterKind::constant) constant_ += e.value;
    if (e.kind == EmitterKind::environment) add_map(scene, e, largest);
  }
  if (fine_.empty()) return;
  table_ = make_table(0.0f);
  const auto is_coated = [](const Bsdf& b) { return is_plastic(b.kind); };
  if (std::any_of(scene.bsdfs.begin(), scene.bsdfs.end(), is_coated)) coated_table_ = make_table(1.0f);
  double rest = 0.0;
  for (const Rgb& c : fine_) rest += double(luminance(c + constant_)) / double(fine_.size());
  mean_ = float(rest);
  if (!concentrated_) return;
  share_ = float(power_ / (power_ + rest));
}

void SkyRadiance::cut_out(const Bitmap& map, const Emitter& emitter, float threshold) {
  Scene scene;
  Bitmap& upper = scene.bitmaps.emplace_back(map);
  for (Rgb& c : upper.pixels) c = positive(c) - rest_of(c, threshold);
  Emitter& e = scene.emitters.emplace_back(emitter);
  e.bitmap = 0;
  concentrated_ = std::make_unique<LightTable>(make_lights(scene));
  const auto width = size_t(map.width);
  std::vector<Vec3> directions;  // of what is not black: few texels
  DVec3 sum(0.0);
  for (size_t i = 0; i < upper.pixels.size(); ++i) {
    const float light = luminance(upper.pixels[i]);
    if (!(light > 0.0f)) continue;
    directions.push_back(map_direction(emitter, map, float(i % width), float(i / width)));
    const double weight = row_weight(int(i / width), map.height) / (2.0 * double(width));
    sum += DVec3(directions.back()) * double(light);
    power_ += weight * double(luminance(upper.pixels[i] * emitter.value));
  }
  if (!(glm::length(sum) > 0.0)) return;
  axis_ = Vec3(glm::normalize(sum));
  float farthest = 0.0f;  // chord to a texel
  for (const Vec3& d : directions) farthest = std::max(farthest, glm::length(d - axis_));
  // Between texels the light falls to 0 over one more.
  const float texel = 2.0f * k_pi * (1.0f / float(map.width) + 0.5f / float(map.height - 1));
  angle_ = std::min(2.0f * std::asin(std::min(0.5f * farthest, 1.0f)) + texel, k_pi);
}

// Adds samples all over the map to the cells of the fine grid. Samples of a row are shifted along their columns, in
// k_phases groups: else all cells along a horizon had the same rows, the next ones others, and a row on the border
// between two would be all of one's.
void SkyRadiance::add_map(const Scene& scene, const Emitter& emitter, double largest) {
  const Bitmap& map = scene.bitmaps[emitter.bitmap];
  const float threshold = concentration_threshold(map, largest);
  if (threshold < k_infinity) cut_out(map, emitter, threshold);
  constexpr size_t k_cells = size_t(k_fine_cells) * size_t(k_fine_cells);
  // About as dense along columns as along rows, whatever the map's shape: every cell has samples.
  const double wanted_rows = std::sqrt(0.5 * k_fine_samples * double(k_cells));
  const auto times = [](double wanted, int held) { return std::max(1, int(std::ceil(wanted / double(held)))); };
  const int finer_rows = times(wanted_rows, map.height - 1), finer_columns = times(2.0 * wanted_rows, map.width);
  const int rows = (map.height - 1) * finer_rows, columns = map.width * finer_columns;
  struct Sum {
    DVec3 light = DVec3(0.0);
    double area = 0.0;
  };
  struct Phase {
    float shift;                     // of a row
    int count;                       // columns, every k_phases-th
    AlignedVector<float> around[3];  // the equator's directions
  };
  constexpr int k_phases = 8;
  constexpr int k_order[k_phases] = {0, 4, 2, 6, 1, 5, 3, 7};  // neighbours far apart
  std::vector<Phase> phases(k_phases);
  const auto column_of = [&](int phase, int k) { return (float(phase + k_phases * k) + 0.5f) / float(finer_columns); };
  for (int p = 0; p < k_phases; ++p) {
    Phase& phase = phases[size_t(p)];
    phase.shift = (float(k_order[p]) + 0.5f) / float(k_phases);
    phase.count = (columns - p + k_phases - 1) / k_phases;
    for (auto& component : phase.around) component.assign(padded(size_t(phase.count)), 0.0f);
    for (int k = 0; k < phase.count; ++k) {
      const Vec3 d = map_direction(emitter, map, column_of(p, k), 0.5f * float(map.height - 1));
      for (int a = 0; a < 3; ++a) phase.around[a][size_t(k)] = d[a];
    }
  }
  const auto find_cells = cell_kernels(resolve_isa(Isa::automatic)).find_cells;  // the same by any
  std::vector<std::vector<Sum>> bands(k_bands);
  parallel_for(k_bands, [&](size_t band) {
    std::vector<Sum>& sums = bands[band];
    sums.resize(k_cells);
    std::vector<Rgb> above(size_t(map.width) + 1), below(above);  // what is left of the rows about a sample
    const auto fill = [&](std::vector<Rgb>& row, int y) {
      const Rgb* const texels = &map.pixels[size_t(y) * size_t(map.width)];
      for (int x = 0; x < map.width; ++x) row[size_t(x)] = rest_of(texels[x], threshold);
      row.back() = row.front();
    };
    int held = -1;  // the upper one
    AlignedVector<int32_t> cells(padded(size_t(columns)));
    for (int row = int(size_t(rows) * band / k_bands); row < int(size_t(rows) * (band + 1) / k_bands); ++row) {
      const int upper = row / finer_rows;
      if (upper != held) {
        if (held >= 0) {
          std::swap(above, below);
        } else {
          fill(above, upper);
        }
        fill(below, upper + 1);
        held = upper;
      }
      for (int p = 0; p < k_phases; ++p) {
        const Phase& phase = phases[size_t(p)];
        const float y = (float(row) + phase.shift) / float(finer_rows);
        const double theta = double(k_pi) * double(y) / double(map.height - 1);
        const double sine = std::sin(theta);
        const Vec3 up = emitter.rotation[1] * float(std::cos(theta));
        find_cells({phase.around[0].data(),
                    phase.around[1].data(),
                    phase.around[2].data(),
                    int32_t(padded(size_t(phase.count))),
                    float(sine),
                    {up.x, up.y, up.z}},
                   k_fine_cells, cells.data());
        for (int k = 0; k < phase.count; ++k) {
          const float x = column_of(p, k), across = x - std::floor(x), down = y - float(upper);
          const auto left = size_t(x);
          const Rgb light = glm::mix(glm::mix(above[left], above[left + 1], across),
                                     glm::mix(below[left], below[left + 1], across), down);
          Sum& sum = sums[size_t(cells[size_t(k)])];
          sum.light += DVec3(light) * sine;
          sum.area += sine;
        }
      }
    }
  });
  std::vector<DVec3> means(k_cells, DVec3(0.0));
  Sum whole;
  DVec3 found(0.0);
  for (size_t i = 0; i < k_cells; ++i) {
    Sum all;
    for (const std::vector<Sum>& sums : bands) all.light += sums[i].light, all.area += sums[i].area;
    whole.light += all.light, whole.area += all.area;
    if (all.area > 0.0) means[i] = all.light / all.area;
    found += means[i] / double(k_cells);
  }
  // Of narrow bright bands cells have a little more light than there is, or less, by the samples that fall in each.
  DVec3 scale(1.0);
  for (int c = 0; c < 3; ++c) {
    if (found[c] > 0.0) scale[c] = whole.light[c] / whole.area / found[c];
  }
  fine_.resize(k_cells, Rgb(0.0f));
  for (size_t i = 0; i < k_cells; ++i) fine_[i] += Rgb(means[i] * scale) * emitter.value;
}

CellLights SkyCells::lights() const {
  return {vx.data(),  vy.data(),    vz.data(),   half_width.data(),    solid_angle.data(),
          red.data(), green.data(), blue.data(), int32_t(cells.size())};
}

void SkyRadiance::add_cell(const Mat3& grid, const SkyCell& cell, SkyCells& cells) const {
  // Samples at least as dense as the fine grid; on the world's grid they are its cells.
  const int side = (k_fine_cells - 1) / cell.side + 1;
  const float step = 1.0f / float(side);
  Rgb light(0.0f);
  Vec3 direction(0.0f);
  float weight = 0.0f;
  for (int k = 0; k < side * side; ++k) {
    const Vec3 d = grid * direction_in_cell(cell.u, cell.v, (float(k / side) + 0.5f) * step,
                                            (float(k % side) + 0.5f) * step, cell.side);
    const Rgb sample = radiance(d);
    // A black sky has directions, too.
    const float of_sample = luminance(sample) + 1e-30f;
    light += sample - constant_;
    direction += d * of_sample;
    weight += of_sample;
  }
  const Rgb mean = constant_ + light * (step * step);
  const Vec3 d = direction / weight;
  cells.cells.push_back(cell);
  // The maps' own directions serve an even sky best.
  cells.directions.push_back(fine_.empty() ? cell_frame(cell.u, cell.v, cell.side).c
                                           : glm::normalize(glm::transpose(grid) * d));
  cells.half_width.push_back(cell_half_width(cell.side));
  cells.solid_angle.push_back(cell.width() * cell.width());
  cells.red.push_back(mean.x), cells.green.push_back(mean.y), cells.blue.push_back(mean.z);
  cells.vx.push_back(d.x), cells.vy.push_back(d.y), cells.vz.push_back(d.z);
}

// Whether luminance differs by more than the sky's mean: by the corners and the centre of the cell.
bool SkyRadiance::varies(const Mat3& grid, const SkyCell& cell) const {
  const float places[5][2] = {{0.5f, 0.5f}, {0, 0}, {0, 1}, {1, 0}, {1, 1}};
  float least = k_infinity, most = 0.0f;
  for (const auto& at : places) {
    const float l = luminance(radiance(grid * direction_in_cell(cell.u, cell.v, at[0], at[1], cell.side)));
    least = std::min(least, l), most = std::max(most, l);
  }
  return most - least > mean_;
}

SkyCells SkyRadiance::cells(const Mat3& grid, int directions, int parts) const {
  SkyCells cells;
  std::vector<SkyCell> varying;
  for (int i = 0; i < directions * directions; ++i) {
    const SkyCell cell = {i / directions, i % directions, directions};
    if (parts > 1 && !fine_.empty() && varies(grid, cell)) {
      varying.push_back(cell);
    } else {
      add_cell(grid, cell, cells);
    }
  }
  for (const SkyCell& cell : varying) {
    for (int k = 0; k < parts * parts; ++k) {
      add_cell(grid, {cell.u * parts + k / parts, cell.v * parts + k % parts, directions * parts}, cells);
    }
  }
  return cells;
}

std::vector<Rgb> SkyRadiance::make_table(float grazing) const {
  const SkyCells sky = cells(Mat3(1.0f), k_table_cells);
  const auto sum_cells = cell_kernels(resolve_isa(Isa::automatic)).sum_cells;  // the same bits by any
  constexpr size_t k_side = size_t(k_table_cells) + 1;
  std::vector<Rgb> table(k_side * k_side);
  parallel_for(k_side, [&](size_t row) {
    AlignedVector<float> x(padded(k_side), 0.0f), y(x), z(x), red(x), green(x), blue(x);
    for (size_t i = 0; i < k_side; ++i) {
      const float step = 2.0f / float(k_table_cells);
      const auto d = scalar::frame_from_square<float>(float(row) * step - 1.0f, float(i) * step - 1.0f).c;
      x[i] = d.x, y[i] = d.y, z[i] = d.z;
    }
    sum_cells(sky.lights(), {x.data(), y.data(), z.data(), int32_t(x.size())}, grazing,
              {red.data(), green.data(), blue.data()});
    for (size_t i = 0; i < k_side; ++i) table[row * k_side + i] = Rgb(red[i], green[i], blue[i]);
  });
  return table;
}

Rgb SkyRadiance::radiance(const Vec3& d) const {
  if (fine_.empty()) return constant_;
  // Values lie at the cells' centres. Beyond the outermost ones, at the square's edges, they are constant.
  return constant_ + interpolate(fine_, k_fine_cells, d, 0.5f * float(k_fine_cells), -0.5f);
}

Rgb SkyRadiance::irradiance(const Vec3& n, float grazing) const {
  if (table_.empty()) return constant_ * (k_pi * (1.0f - grazing / 21.0f));  // the integral of 2 c (1 - c)^5
  const auto read = [&](const std::vector<Rgb>& table) {
    return interpolate(table, k_table_cells + 1, n, 0.5f * float(k_table_cells), 0.0f);
  };
  return grazing > 0.0f ? glm::mix(read(table_), read(coated_table_), grazing) : read(table_);
}

}  // namespace fieldtrace
