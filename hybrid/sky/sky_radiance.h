// The light that surrounds a scene (`constant` and `environment` emitters together), prefiltered by direction cells.
//
// Cells are those of the equal-area octahedral map of field/chart/chart.hd.h, D x D of solid angle 4 pi / D^2, number
// u D + v. A concentrated source such as a sun is cut out: its shadows are sharper than cells, and it is sampled as a
// light of its own. For each texel L = L min(1, t / Y) + the rest, Y its luminance; between texels both parts are
// interpolated, so that they add up to the map exactly.
// Space: world. Thread-safety: const after construction, which is parallel.
#pragma once

#include <memory>
#include <vector>

#include "core/light/light_sampling.h"
#include "core/math/math.h"
#include "core/platform/aligned_vector.h"
#include "core/scene/scene.h"
#include "field/maps/cell_task.h"

namespace fieldtrace {

struct SkyCells {
  float half_width = 0.0f;                // half extent of a cell, radians
  AlignedVector<float> red, green, blue;  // mean radiance
  AlignedVector<float> vx, vy, vz;        // mean direction, weighted by luminance: shorter than 1
  // Shares of the light of k_cell_parts parts of each cell (part x k_parts_side + y), where they differ.
  std::vector<float> parts;
  std::vector<uint8_t> varies;
  // Irradiance (luminance) on a surface of unit normal `n` as the sum over all cells: differs from that of the whole
  // sky by about 1/1000.
  float irradiance(const Vec3& n) const;
  const float* parts_of(size_t cell) const { return varies[cell] ? &parts[cell * size_t(k_cell_parts)] : nullptr; }
};

class SkyRadiance {
 public:
  // Unchecked: the caller guarantees a scene that make_lights() accepts.
  explicit SkyRadiance(const Scene& scene);

  // The cells of a grid whose axes are the columns of `grid`, a rotation that may mirror.
  SkyCells cells(const Mat3& grid, int directions) const;
  // Radiance from a unit direction, without what is concentrated: interpolated on a fine grid.
  Rgb radiance(const Vec3& d) const;
  // Irradiance of the open sky, without what is concentrated, on a surface of the unit normal `n`.
  Rgb irradiance(const Vec3& n) const;
  // What was cut out, as light 0 of a table; null: nothing.
  const LightTable* concentrated() const { return concentrated_.get(); }
  // A cone that holds it: unit axis and half angle, radians.
  Vec3 concentrated_axis() const { return axis_; }
  float concentrated_angle() const { return angle_; }
  // Whether a scene has no sky, or none that lights it.
  bool is_black() const { return constant_ == Rgb(0.0f) && fine_.empty(); }
  // Its part of the whole sky's power, by luminance.
  float concentrated_share() const { return share_; }

 private:
  void add_map(const Scene& scene, const Emitter& emitter);
  void cut_out(const Bitmap& map, const Emitter& emitter, float threshold);
  void make_table();

  Rgb constant_ = Rgb(0.0f);
  // The maps, by cells of a fine grid; empty: none.
  std::vector<Rgb> fine_;
  // Irradiance by normal at the corners of a grid over the octahedral square; empty without maps.
  std::vector<Rgb> table_;
  std::unique_ptr<LightTable> concentrated_;
  double power_ = 0.0;  // mean luminance over the sphere
  Vec3 axis_ = Vec3(0.0f, 0.0f, 1.0f);
  float angle_ = k_pi, share_ = 0.0f;
};

}  // namespace fieldtrace
