// Points of an object's surface (surfels: Pfister, Zwicker, van Baar and Gross, "Surfels: Surface Elements as Rendering
// Primitives", SIGGRAPH 2000), each for one small patch, and which of them the texels of radiance pyramids see.
//
// Space: object space, but for lines through the unit ball. Thread-safety: const once made.
#pragma once

#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/trace/accel.h"
#include "hybrid/sky/mapped_shapes.h"
#include "hybrid/sky/parallelogram.h"

namespace fieldtrace {

struct SurfaceSpot {
  Vec3 position;
  uint32_t primitive;
};

struct Surfel {
  SurfaceSpot spot;
  Vec3 normal;  // unit and geometric, on the side that is seen
};

struct Surfels {
  // The reflectance of a surfel is the mean over so many places.
  static constexpr int k_reflectance_spots = 8;

  std::vector<Surfel> points;
  // By point: the one of a few side by side that stands for them where light is smooth; its own is itself.
  std::vector<uint32_t> representative;
  std::vector<SurfaceSpot> reflectance_spots;  // k_reflectance_spots for each
  std::vector<uint32_t> texels;                // [pyramid][y][x], index of a point; k_none: nothing is seen
};

// Of a shape: those that parallel lines through the T x T texels of each cell of D x D directions
// meet, merged by voxels and the main axis of their normals. Pyramid 2 i + s: seen along direction i, what a line meets
// first (s = 0), and the last that it meets from outside (1). Nothing where it is unknown which sides lie outside: of
// cups and sheets with folds, from whose insides a line's last surface is another.
Surfels make_surfels(const Accel& accel, const MappedShape& shape, int directions, int texels);

// A rectangle of a parallelogram's coordinates.
struct PlaneWindow {
  Vec2 lower = Vec2(-1.0f), upper = Vec2(1.0f);
};
// Of a parallelogram: one at the middle of each texel that lies in no later window. Pyramid 2 w + s: window w, the side
// that `normal` points to (s = 0) or the other; `sides` tells which of them are wanted.
Surfels make_plane_surfels(const Accel& accel, uint32_t shape, const Parallelogram& plane, const Vec3& normal,
                           std::span<const PlaneWindow> windows, int texels, const bool sides[2]);

}  // namespace fieldtrace
