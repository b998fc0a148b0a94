// One light as plain data in world space, ready for sampling, and which of its samples are wanted.
//
// Memory layout: a flat struct of 4-byte members that refers to its table's triangles by index; the same bytes serve
// every instruction set and a GPU. Thread-safety: a value, const after make_lights.
#pragma once

#include <cstdint>

namespace fieldtrace {

// How a light is sampled, which is more than its shape.
enum class LightKind : uint32_t {
  none,           // emits nothing that can be sampled: black or of zero area
  sphere,         // seen from outside: by its visible cone
  sphere_inside,  // a sphere with inward normals: by area
  rectangle,      // unsheared: as a spherical rectangle
  parallelogram,  // sheared: by area
  disk,           // and ellipses: by area
  ellipsoid,      // by area, with the Jacobian of the affine map
  cylinder,       // likewise
  mesh,           // triangles by area
  point,
  directional,
  constant,     // the whole sphere of directions
  environment,  // likewise, by the brightness of an image
};

struct Light {
  LightKind kind = LightKind::none;
  uint32_t instance = 0xffffffffu;  // of the scene, for area lights
  // Emitter::value: radiance, intensity or irradiance. Environments: multiplied by the power of two that
  // EnvironmentTable::texels were divided by.
  float value[3] = {0, 0, 0};
  float centre[3] = {0, 0, 0};  // of the shape; point: position; directional: unit direction towards the light
  // Columns of the shape's object-to-world matrix. Rectangle, parallelogram: half edges; disk: half axes; environment:
  // the rotation from map to world.
  float axis[3][3] = {};
  // Columns of the inverse transpose, times -1 if normals are flipped: a normal n of the unit shape becomes n.x
  // normal_axis[0] + n.y normal_axis[1] + n.z normal_axis[2], not normalised.
  float normal_axis[3][3] = {};
  float normal[3] = {0, 0, 1};  // planar kinds: unit, on the emitting side
  float unit_axis[2][3] = {};   // rectangle: unit edges
  float half_size[2] = {0, 0};  // rectangle: half lengths of the edges
  float emission_sign = 1;      // -1 if normals are flipped
  float radius = 0;             // sphere
  float area = 0;               // world area (ellipsoid, cylinder: |det| times the unit shape's area)
  // Displacement of a sampled point off the light's surface, towards the emitting side, so that a ray ending there
  // cannot hit the light: error_base + error_slope (|x| + |y| + |z|) for a ray origin (x, y, z).
  float error_base = 0, error_slope = 0;
  uint32_t first_triangle = 0, triangle_count = 0;  // mesh: range of the table's triangles
  uint32_t width = 0, height = 0;                   // environment: texels
  float luminance[3] = {0, 0, 0};                   // environment: density (1/sr) per unit of each texel channel
};

// One triangle of a mesh light, as 16 floats that lane code gathers by index.
struct LightTriangle {
  float p0[3], edge1[3], edge2[3];
  float normal[3];        // unit, on the emitting side
  float inverse_density;  // area / probability of the triangle: 1 / (density per area)
  float cdf;              // sum of the probabilities of the triangles before this one
  float unused[2] = {0, 0};
};
inline constexpr int k_light_triangle_floats = sizeof(LightTriangle) / sizeof(float);
static_assert(sizeof(LightTriangle) == 16 * sizeof(float));

// One row of an environment's texels, as 8 floats. Row y lies at polar angle theta = pi y / (height - 1), and its strip
// reaches down to row y + 1. The last row has no strip: its start, delta and scale are not read.
struct EnvironmentRow {
  float start;         // probability of all strips above this row
  float sum;           // of the row's densities
  float north, south;  // 1 - cos theta and 1 + cos theta
  float delta;         // of cos theta over the strip
  float scale;         // width / (2 pi delta): probability within the strip to the integral of `sum` over it
  float unused[2] = {0, 0};
};
inline constexpr int k_environment_row_floats = sizeof(EnvironmentRow) / sizeof(float);
static_assert(sizeof(EnvironmentRow) == 8 * sizeof(float));

// Which of each shading point's samples a batch holds: numbers first ... first + count - 1 of `total`, taken from the
// shading point's sequence; or, with columns > 0 (not for mesh lights), the centres of the cells of a grid of `columns`
// columns and total / columns rows (which must be whole; total >= 2) over the sample square, row by row.
//
// cell_columns > 0: the cells of a grid of cell_columns x cell_rows over that square that the samples lie in are
// wanted, in ShadowBatch::cell.
struct LightSampleRange {
  int total = 1, first = 0, count = 1;
  int columns = 0;
  int cell_columns = 0, cell_rows = 0;
};

// Pairs of sample dimensions: light i uses k_light_dimension + 2 i and the next; BSDFs and the camera stay below.
inline constexpr uint32_t k_light_dimension = 0x40000000u;

// The origin is moved by error (1 + 2^-21) + 2^-23 |p|, where |p| is the sum of the coordinates' magnitudes. The
// computed sum p + g e is off by at most u (|p| + (1 + sqrt 3) e) along g (u = 2^-24: one rounding per product and
// sum), so an offset of at least `error` remains; both factors have a margin of two.
inline constexpr float k_offset_error_scale = 1.0f + 0x1p-21f;
inline constexpr float k_offset_rounding = 0x1p-23f;

// The end of rays to lights at infinity.
inline constexpr float k_no_end = __builtin_huge_valf();

}  // namespace fieldtrace
