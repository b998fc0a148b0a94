// The light of direction cells, directions and surfaces that it falls on. Plain data, shared by every instruction set.
//
// Thread-safety: values.
#pragma once

#include <cstdint>

namespace fieldtrace {

// Structures of arrays of `count` values.
struct CellLights {
  const float *vx, *vy, *vz;        // mean direction, weighted by luminance: of length <= 1
  const float* half_width;          // half extent, radians
  const float* solid_angle;         // steradians
  const float *red, *green, *blue;  // mean radiance
  int32_t count = 0;
};

// Unit normals, structures of arrays of `size` values (a multiple of the vector's length), aligned.
struct CellNormals {
  const float *x, *y, *z;
  int32_t size = 0;
};

// Unit directions: `sine` times vectors of the equator plus `up`. Structures of arrays of `size` values (a multiple of
// the vector's length), aligned.
struct DirectionRow {
  const float *x, *y, *z;  // of the equator, unit
  int32_t size = 0;
  float sine = 1.0f;
  float up[3] = {};
};

// Irradiance; aligned, one value a normal.
struct CellLightSums {
  float *red, *green, *blue;
};

}  // namespace fieldtrace
