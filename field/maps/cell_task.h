// One direction cell of the sky, as a batch of shading points of one instance asks about it. Plain data, shared by
// every instruction set and the GPU.
//
// Space: world, relative to nothing. Rows of four are affine functions of the point, x, y, z and a constant.
// Thread-safety: values.
#pragma once

#include <cstddef>
#include <cstdint>

#include "field/maps/maps_view.h"
#include "field/maps/radiance_view.h"

namespace fieldtrace {

// A texel that a footprint is read from, in widths of the cell: a tent and its texel of this width have the variance of
// a box of width 1.
inline constexpr float k_footprint = 0.58f;

// The lines of an object's map that stand for the cell's rays.
struct MapLines {
  float u[4], v[4];                // the point in the map, texels: where the map's line through it crosses the plane
  float z[4];                      // its coordinate along the map's direction
  float slope_u = 0, slope_v = 0;  // texels that the cell's ray moves per unit of z: it is not quite the map's line
  float reach = 0;                 // texels of the footprint per unit of z
  float per_z = 0;                 // world units along the cell's ray per unit of z
  float margin = 0;                // depths nearer than this to the point's are undecided, units of z
  int32_t depth_begin = 0, coverage_begin = 0;  // of the map, bytes
  const MapsView* maps = nullptr;
  // For cells seen within a distance (cell_within.hd.h): the distance, units of z, and the map of the opposite
  // direction.
  float within = 0;
  int32_t back_begin = 0;  // bytes
};

// What the object sends back along the cell: the lines of the nearest of its radiance maps, whose directions may be
// fewer.
struct MapRadiance {
  float u[4], v[4];
  float slope_u = 0, slope_v = 0, reach = 0;  // as MapLines
  float place = 0;                            // the object's centre along the cell's direction, world units
  // Pyramids, bytes: of what rays from outside the ball meet first, and of what those from within meet last.
  int32_t outer = 0, inner = 0;
  const RadianceView* view = nullptr;
};

// The same of the object that the points lie on, along a direction of its own grid.
struct OwnLines {
  MapLines lines;
  float s[3], t[3], c[3];           // the map's frame in world space, unit
  float clear_within, hidden_from;  // texels above the tangent plane; between the two undecided
};

// Changes per world unit along a direction.
struct PlaneSlope {
  float dx, dy;  // of a parallelogram's coordinates
  float rise;    // of the height over it
};

// A rectangle of a parallelogram's coordinates that a pyramid covers.
struct RadianceWindow {
  float x = 0, y = 0;                    // its middle
  float per_unit_x = 0, per_unit_y = 0;  // texels per unit of the coordinates
  float density = 0;                     // texels per world unit: the root of those per area
};

// What a parallelogram sends back. Pyramid 2 w + s: of window w, and of the side that the height is positive on (0) or
// the other (1). Window 0 covers all; later ones go before.
struct PlaneRadiance {
  const RadianceView* view = nullptr;
  int32_t begin = 0;  // of its pyramids, bytes
  int windows = 0;
  RadianceWindow window[2];
};

// A parallelogram [-1, 1]^2 of its own coordinates.
struct PlaneLines {
  float x[4], y[4];  // the point's coordinates
  float height[4];   // its distance from the plane, world units, signed
  // Whether it is seen from where the height is positive alone, but for points whose height is no less than this, which
  // rounding has put behind it.
  bool one_sided = false;
  float least_height = 0.0f;
  PlaneSlope centre;  // along the cell's direction
  // Of the coordinates' gradients: squared lengths, and their product.
  float per_unit_x, per_unit_y, x_dot_y;
  const PlaneRadiance* radiance = nullptr;
};

// A ball whose inside only rays can see.
struct BallLines {
  float centre[3];
  float radius;
};

// What the points' own object hides of a cell, by point: its share, and 1 where it is undecided, else 0.
struct OwnShares {
  float *hidden, *near;
};

struct CellTask {
  float direction[3];  // unit, of the centre of the cell's light
  float half = 0;      // half extent of the cell, radians
  float vector[3];     // SkyCells: mean direction by luminance, of length <= 1
  float cosine_half = 0;
  float weight[3];     // radiance x solid angle, RGB
  float clear = 1.0f;  // share that what is not listed leaves
  const OwnLines* own = nullptr;
  const OwnShares* own_shares = nullptr;  // of `own`, where they are known
  const MapLines* maps = nullptr;
  const PlaneLines* planes = nullptr;
  const BallLines* balls = nullptr;
  int map_count = 0, plane_count = 0, ball_count = 0;
  // Null: nothing sends light back. Otherwise that of `own`, and those of `maps`, which then ascend by their place.
  const MapRadiance* own_radiance = nullptr;
  const MapRadiance* map_radiance = nullptr;
  bool reflects = false;
  // The shading normals are not the geometric ones, of points whose own object hides nothing from them.
  bool bent = false;
  float within = 0;  // world units: farther surfaces hide nothing; cell_within.hd.h alone
};

// Shading points of one instance, structures of arrays of `size` values (a multiple of the vector's length), aligned.
struct CellPoints {
  const float *px, *py, *pz;  // positions
  const float *gx, *gy, *gz;  // geometric normals on the shaded side
  const float *sx, *sy, *sz;  // shading normals
  int32_t size = 0;
  // Light that arrives at the cosine c counts for c (1 - grazing (1 - c)^5).
  float grazing = 0.0f;
};

// What cells take from the points' irradiance; aligned, one value a point.
struct CellSums {
  float *red, *green, *blue;  // irradiance that is hidden or undecided
  // What comes back from objects that hide it, without undecided cells; unused unless CellTask::reflects.
  float *reflected_red = nullptr, *reflected_green = nullptr, *reflected_blue = nullptr;
};

// Parallelograms in one cell that are seen together; more count as if they were independent, and send nothing back.
inline constexpr int k_most_planes = 32;

}  // namespace fieldtrace
