// Procedural meshes: the test objects of the thesis (supershape, hyperboloid) and basic shapes.
//
// Sources: supershape: J. Gielis, "A generic geometric transformation that unifies a wide range of natural and abstract
// shapes", American Journal of Botany 90(3), 2003, equations 1 and 4; sizes: A. Andreadis, "Ray Tracing Acceleration
// using Displacement Fields on GPU", 2008, section 4. Knot: a tube around a (p, q) curve on a torus.
//
// All meshes lie in object space around the origin and, with default parameters, within the unit sphere. They have unit
// normals and texture coordinates in [0, 1]^2. Triangles run anticlockwise seen from outside (from +z for the plane).
// Closed surfaces are watertight by position: vertices on a texture seam are repeated bit for bit. Every function
// throws UsageError, naming the option of `fieldtrace mesh`, for a value outside the range stated beside it.
// Thread-safety: pure functions. Memory layout: see core/mesh/mesh.h.
#pragma once

#include "core/mesh/mesh.h"

namespace fieldtrace {

// r(t) = (|cos(m t / 4) / a|^n2 + |sin(m t / 4) / b|^n3)^(-1 / n1).
struct Superformula {
  double m = 0.0;             // [0, 1000], symmetry; 0 with the other defaults gives a circle
  double n1 = 1.0;            // [0.01, 1000]
  double n2 = 1.0, n3 = 1.0;  // [0, 1000]
  double a = 1.0, b = 1.0;    // [0.001, 1000]
};

// Spherical product of two superformulas, z up, scaled so that the farthest vertex lies at distance `radius`. Radii are
// at least 2^-10 of a superformula's largest radius, so that the surface is never pinched to a line. 2 * around *
// (along - 1) triangles; the default is the thesis' 16,128. Smooth (angle-weighted) normals.
struct SupershapeParams {
  Superformula longitude = {.m = 6.0, .n1 = 1.0, .n2 = 1.0, .n3 = 1.0};
  Superformula latitude = {.m = 3.0, .n1 = 1.0, .n2 = 1.0, .n3 = 1.0};
  int around = 128;     // [3, 32768]
  int along = 64;       // [2, 32768], from pole to pole
  float radius = 1.0f;  // [1e-6, 1e6]
};
TriangleMesh make_supershape(const SupershapeParams& params = {});

// Hyperboloid of one sheet about the z axis, open at both ends. 2 * around * along triangles; the default is the
// thesis' 16,384. Normals point away from the axis.
struct HyperboloidParams {
  float waist = 0.3f;        // [1e-6, 1e6], radius at z = 0
  float rim = 0.6f;          // (waist, 1e6], radius at z = +-half_height
  float half_height = 0.8f;  // [1e-6, 1e6]
  int around = 128;          // [3, 32768]
  int along = 64;            // [1, 32768]
};
TriangleMesh make_hyperboloid(const HyperboloidParams& params = {});

// Tube around a curve that winds p times about the z axis and q times about the core of a torus. The tube's frame
// follows the normal of that torus, which is periodic along the curve: no seam, no twist. 2 * along * around triangles.
struct KnotParams {
  int p = 2, q = 3;     // [1, 64] and [0, 64], coprime (else the curve repeats itself)
  float major = 0.6f;   // [1e-6, 1e6], radius of the torus' core circle
  float minor = 0.27f;  // (0, major), radius of the torus
  float tube = 0.11f;   // at least 2^-16 (major + minor), less than the curve's smallest radius of curvature
  int along = 512;      // [8, 4194304]
  int around = 32;      // [3, 32768]
};
TriangleMesh make_knot(const KnotParams& params = {});

// Latitude-longitude sphere, z up. 2 * around * (along - 1) triangles.
struct SphereParams {
  float radius = 1.0f;  // [1e-6, 1e6]
  int around = 128;     // [3, 32768]
  int along = 64;       // [2, 32768]
};
TriangleMesh make_sphere(const SphereParams& params = {});

// [-half_size, half_size]^2 in z = 0, normal +z, texture coordinates from the corner of least x and y. 2 * columns *
// rows triangles.
struct PlaneParams {
  float half_size = 0.70710678f;  // [1e-6, 1e6]; default: the corners lie on the unit sphere
  int columns = 1, rows = 1;      // [1, 32768]
};
TriangleMesh make_plane(const PlaneParams& params = {});

// [-half_size, half_size]^3 with flat faces; each face has separate vertices and covers [0, 1]^2 in texture space. 12 *
// divisions^2 triangles.
struct CubeParams {
  float half_size = 0.57735027f;  // [1e-6, 1e6]; default: the corners lie on the unit sphere
  int divisions = 1;              // [1, 2048] cells along an edge
};
TriangleMesh make_cube(const CubeParams& params = {});

}  // namespace fieldtrace
