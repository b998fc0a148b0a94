// Meshes that are hard for sampled visibility: thin slats, wires, hair, open surfaces, holes, slivers. For tests and
// benchmarks.
//
// All lie in object space around the origin and, with default parameters, within the unit sphere. They have unit
// normals and texture coordinates, and depend on their parameters alone (random ones on the seed). Every function
// throws UsageError for a parameter outside its range. Thread-safety: pure functions. Memory layout: see
// core/mesh/mesh.h.
#pragma once

#include <cstdint>

#include "core/mesh/mesh.h"

namespace fieldtrace {

// Parallel slats (closed boxes) across the y axis within [-0.55, 0.55]^3, each at least 2^-19 thick (else UsageError).
// 12 * slats triangles.
struct CombParams {
  int slats = 24;             // [1, 100000]
  float solid_share = 0.25f;  // [1e-4, 1): thickness of a slat / distance between slats
};
TriangleMesh make_comb(const CombParams& params = {});

// A globe of closed wires: great circles through the poles and circles of latitude. Wires intersect. 2 * around * along
// * (meridians + parallels) triangles.
struct WireGlobeParams {
  int meridians = 12;          // [0, 1000] great circles; meridians + parallels must be positive
  int parallels = 11;          // [0, 1000]
  float wire_radius = 0.012f;  // [1e-5, 0.1], of the globe's radius
  int along = 128;             // [8, 32768]
  int around = 6;              // [3, 256]
};
TriangleMesh make_wire_globe(const WireGlobeParams& params = {});

// Hairs: closed, tapering, bent tubes growing outwards from a sphere. 6 * segments triangles each.
struct HairBallParams {
  int hairs = 2000;            // [1, 1000000]
  int segments = 4;            // [1, 64]
  float hair_radius = 0.003f;  // [1e-5, 0.05] at the root
  float ball_radius = 0.35f;   // [0.05, 0.9]: where hairs start; they end at about 0.95
  float bend = 0.5f;           // [0, 1]: sideways drift of the tip / length
  uint32_t seed = 1;
};
TriangleMesh make_hair_ball(const HairBallParams& params = {});

// Open surface z = amplitude * sin(k x) * cos(k y) over a square, visible from both sides. 2 * cells^2 triangles.
struct WavySheetParams {
  float half_size = 0.68f;  // [0.01, 0.7]
  float amplitude = 0.08f;  // [0, 0.15]
  float waves = 4.0f;       // [0, 1000] along an edge
  int cells = 96;           // [1, 4096] along an edge
};
TriangleMesh make_wavy_sheet(const WavySheetParams& params = {});

// Unit sphere without the triangles whose centre lies in one of `holes` evenly spread caps: an open surface whose
// inside is visible. Vertices within holes remain, unused. At most 2 * around * (along - 1) triangles.
struct HolySphereParams {
  int holes = 24;                     // [0, 1000]
  float hole_radius_degrees = 12.0f;  // [0, 60]
  int around = 192, along = 96;       // [3, 32768], [2, 32768]
};
TriangleMesh make_holy_sphere(const HolySphereParams& params = {});

// Slivers that share one tip and fan out over half a turn around the x axis, otherwise disjoint.
struct SliverFanParams {
  int slivers = 500;     // [1, 1000000]
  float aspect = 1e-4f;  // [1e-7, 0.1]: width / length
};
TriangleMesh make_sliver_fan(const SliverFanParams& params = {});

}  // namespace fieldtrace
