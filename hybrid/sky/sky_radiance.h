// The light that surrounds a scene (`constant` and `environment` emitters together), prefiltered by direction cells.
//
// Cells are those of the equal-area octahedral map of field/chart/chart.hd.h, D x D of solid angle 4 pi / D^2, number
// u D + v. A concentrated source such as a sun is cut out: its shadows are sharper than cells, and it is sampled as a
// light of its own. For each texel L = L min(1, t / Y) + the rest, Y its luminance; between texels both parts are
// interpolated, so that they add up to the map exactly.
// Space: world. Thread-safety: const after construction, which is parallel.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "core/light/light_sampling.h"
#include "core/math/math.h"
#include "core/platform/aligned_vector.h"
#include "core/scene/scene.h"
#include "field/maps/cell_lights.h"

namespace fieldtrace {

// A cell of the map of side x side cells.
struct SkyCell {
  int32_t u = 0, v = 0, side = 1;
  float width() const { return 2.0f * std::sqrt(k_pi) / float(side); }  // radians
  // The number of the cell of a coarser map that it lies in.
  int within(int directions) const { return u * directions / side * directions + v * directions / side; }
};

// The cells of a map, those whose light varies in parts of their own.
struct SkyCells {
  std::vector<SkyCell> cells;
  std::vector<Vec3> directions;           // unit, of their light's centres, in the grid
  AlignedVector<float> half_width;        // half extent, radians
  AlignedVector<float> solid_angle;       // steradians
  AlignedVector<float> red, green, blue;  // mean radiance
  AlignedVector<float> vx, vy, vz;        // mean direction, weighted by luminance: shorter than 1

  // Their sum of irradiance differs from that of the whole sky by about 1/1000.
  CellLights lights() const;
};

// What is cut out covers less of the sphere than this, or than what the user of a sky asks for.
inline constexpr double k_concentrated_share = 1.0 / 512.0;

class SkyRadiance {
 public:
  // `largest`: what is cut out covers less of the sphere. Unchecked: the caller guarantees a scene that make_lights()
  // accepts.
  explicit SkyRadiance(const Scene& scene, double largest = k_concentrated_share);

  // The cells of a grid whose axes are the columns of `grid`, a rotation that may mirror. Those whose light varies are
  // divided in parts x parts.
  SkyCells cells(const Mat3& grid, int directions, int parts = 1) const;
  // Radiance from a unit direction, without what is concentrated: interpolated on a fine grid.
  Rgb radiance(const Vec3& d) const;
  // Irradiance of the open sky, without what is concentrated, on a surface of the unit normal `n`, by way of an
  // interface (CellPoints::grazing; 0: none, else the scene must have plastics).
  Rgb irradiance(const Vec3& n, float grazing = 0.0f) const;
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
  void add_map(const Scene& scene, const Emitter& emitter, double largest);
  void cut_out(const Bitmap& map, const Emitter& emitter, float threshold);
  std::vector<Rgb> make_table(float grazing) const;
  bool varies(const Mat3& grid, const SkyCell& cell) const;
  void add_cell(const Mat3& grid, const SkyCell& cell, SkyCells& cells) const;

  Rgb constant_ = Rgb(0.0f);
  // The maps, by cells of a fine grid; empty: none.
  std::vector<Rgb> fine_;
  // Irradiance by normal at the corners of a grid over the octahedral square; empty without maps.
  std::vector<Rgb> table_, coated_table_;  // the latter for a grazing of 1, if the scene has plastics
  std::unique_ptr<LightTable> concentrated_;
  float mean_ = 0.0f;   // luminance over the sphere, without what is concentrated, if there are maps
  double power_ = 0.0;  // the same of what is concentrated
  Vec3 axis_ = Vec3(0.0f, 0.0f, 1.0f);
  float angle_ = k_pi, share_ = 0.0f;
};

}  // namespace fieldtrace
