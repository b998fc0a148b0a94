#include "core/mesh/mesh_procedural.h"

#include <algorithm>
#include <numeric>

#include "core/mesh/mesh_grid.h"

namespace fieldtrace {
namespace {

using namespace mesh_grid;

constexpr double k_pi_d = 3.14159265358979323846;
constexpr int k_max_cells = 32768;
constexpr double k_min_size = 1e-6, k_max_size = 1e6;  // squares stay well within the range of float

// sin and cos of turns * 2 pi, exactly 0 and +-1 at quarter turns, so that shapes are symmetric to the last bit.
struct SinCos {
  double sin, cos;
};
SinCos sin_cos_turn(int64_t numerator, int64_t denominator) {
  int64_t k = numerator % denominator;
  if (k < 0) k += denominator;
  const int64_t quarter = 4 * k / denominator;
  const double rest = 2.0 * k_pi_d * double(4 * k - quarter * denominator) / (4.0 * double(denominator));
  const double s = std::sin(rest), c = std::cos(rest);
  switch (quarter) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

// ---------------------------------------------------------------- supershape

// Minimum radius relative to the superformula's largest; below it the surface would be so pinched that neighbouring
// vertices coincide in float. Far above float's 2^-24, far below what is visible.
constexpr double k_min_radius_share = 0x1p-10;

// `suffix`: of the options.
void check(const std::string& suffix, const Superformula& f) {
  const auto range = [&](const char* name, double value, double least, double most) {
    require_range("supershape", ("--" + (name + suffix)).c_str(), value, least, most);
  };
  range("m", f.m, 0.0, 1000.0);
  range("n1", f.n1, 0.01, 1000.0);
  range("n2", f.n2, 0.0, 1000.0);
  range("n3", f.n3, 0.0, 1000.0);
  range("a", f.a, 0.001, 1000.0);
  range("b", f.b, 0.001, 1000.0);
}

// log r(t). Logarithms, because the powers leave the range of double long before the parameters are unusual.
double log_radius(const Superformula& f, double t) {
  const double c = f.n2 * std::log(std::abs(std::cos(0.25 * f.m * t)) / f.a);
  const double s = f.n3 * std::log(std::abs(std::sin(0.25 * f.m * t)) / f.b);
  // 0 * log(0) stands for 0^0 = 1; a power of 0 alone has log = -infinity, which exp maps to 0. One of the two is
  // finite.
  const double x = std::isnan(c) ? 0.0 : c, y = std::isnan(s) ? 0.0 : s;
  const double hi = std::max(x, y), lo = std::min(x, y);
  return -(hi + std::log1p(std::exp(lo - hi))) / f.n1;
}

// Radii at `count` + 1 angles from `begin` to `end`, scaled so that the largest is 1, with the minimum radius enforced.
std::vector<double> radii(const Superformula& f, double begin, double end, int count) {
  std::vector<double> r(size_t(count) + 1);
  for (int i = 0; i <= count; ++i) r[size_t(i)] = log_radius(f, begin + (end - begin) * (double(i) / count));
  const double largest = *std::max_element(r.begin(), r.end());
  for (double& x : r) x = std::max(std::exp(x - largest), k_min_radius_share);
  return r;
}

}  // namespace

TriangleMesh make_supershape(const SupershapeParams& params) {
  check("", params.longitude);
  check("-lat", params.latitude);
  require_count("supershape", "--around", params.around, 3, k_max_cells);
  require_count("supershape", "--along", params.along, 2, k_max_cells);
  require_range("supershape", "--radius", params.radius, k_min_size, k_max_size);
  const GridShape grid{params.around, params.along, true, false, true};
  require_triangles("supershape", triangle_count(grid));

  const std::vector<double> lon = radii(params.longitude, -k_pi_d, k_pi_d, params.around);
  const std::vector<double> lat = radii(params.latitude, -0.5 * k_pi_d, 0.5 * k_pi_d, params.along);
  const auto point = [&](int i, int j) {
    const SinCos theta = sin_cos_turn(2 * int64_t(i) - params.around, 2 * int64_t(params.around));
    const SinCos phi = sin_cos_turn(2 * int64_t(j) - params.along, 4 * int64_t(params.along));
    const double across = lon[size_t(i)] * lat[size_t(j)] * phi.cos;
    return DVec3(across * theta.cos, across * theta.sin, lat[size_t(j)] * phi.sin);
  };
  double farthest = 0.0;
  for (int j = 0; j <= params.along; ++j) {
    for (int i = 0; i < params.around; ++i) farthest = std::max(farthest, glm::length(point(i, j)));
  }
  const double scale = double(params.radius) / farthest;
  return build(grid, GridNormals::smooth, [&](int i, int j) { return SurfacePoint{scale * point(i, j), DVec3(0.0)}; });
}

// ---------------------------------------------------------------- hyperboloid

TriangleMesh make_hyperboloid(const HyperboloidParams& params) {
  require_range("hyperboloid", "--waist", params.waist, k_min_size, k_max_size);
  require_range("hyperboloid", "--rim", params.rim, params.waist, k_max_size);
  require(params.rim > params.waist, "hyperboloid: --rim must be larger than --waist");
  require_range("hyperboloid", "--half-height", params.half_height, k_min_size, k_max_size);
  require_count("hyperboloid", "--around", params.around, 3, k_max_cells);
  require_count("hyperboloid", "--along", params.along, 1, k_max_cells);
  const GridShape grid{params.around, params.along, true, false, false};
  require_triangles("hyperboloid", triangle_count(grid));

  // (x^2 + y^2) / a^2 - z^2 / c^2 = 1 with c such that the radius at half_height is the rim:
  // 1 / c^2 = (rim - a) (rim + a) / (a half_height)^2.
  const double a = params.waist, h = params.half_height;
  const double inv_c2 = (double(params.rim) - a) * (double(params.rim) + a) / (a * a * h * h);
  return build(grid, GridNormals::given, [&](int i, int j) {
    const SinCos theta = sin_cos_turn(i, params.around);
    const double z = h * (double(2 * j - params.along) / params.along);
    const double r = a * std::sqrt(1.0 + z * z * inv_c2);
    // Half the gradient, times a^2.
    return SurfacePoint{{r * theta.cos, r * theta.sin, z}, {r * theta.cos, r * theta.sin, -z * inv_c2 * a * a}};
  });
}

// ---------------------------------------------------------------- knot

TriangleMesh make_knot(const KnotParams& params) {
  require_count("knot", "--p", params.p, 1, 64);
  require_count("knot", "--q", params.q, 0, 64);
  require(std::gcd(params.p, params.q) == 1, "knot: --p and --q have a common factor, divide both by it");
  require_range("knot", "--major", params.major, k_min_size, k_max_size);
  require_range("knot", "--minor", params.minor, 0.0, params.major);
  require(params.minor > 0.0f && params.minor < params.major, "knot: --minor must lie between 0 and --major");
  require_count("knot", "--along", params.along, 8, 1 << 22);
  require_count("knot", "--around", params.around, 3, k_max_cells);
  const GridShape grid{params.along, params.around, true, true, false};
  require_triangles("knot", triangle_count(grid));

  const double major = params.major, minor = params.minor, p = params.p, q = params.q;
  struct Frame {
    DVec3 position, side, up;  // point on the curve, and the tube's frame there
    double curvature;
  };
  const auto frame_at = [&](int i) {
    const SinCos u = sin_cos_turn(int64_t(params.p) * i, params.along);  // about z
    const SinCos v = sin_cos_turn(int64_t(params.q) * i, params.along);  // about the core
    const DVec3 out(u.cos, u.sin, 0.0), ahead(-u.sin, u.cos, 0.0), z(0.0, 0.0, 1.0);
    const double r = major + minor * v.cos;
    const DVec3 d1 = -minor * q * v.sin * out + p * r * ahead + minor * q * v.cos * z;
    const DVec3 d2 =
        (-minor * q * q * v.cos - p * p * r) * out - 2.0 * p * q * minor * v.sin * ahead - minor * q * q * v.sin * z;
    const double speed = glm::length(d1);
    // The torus normal is perpendicular to every curve on the torus.
    const DVec3 side = v.cos * out + v.sin * z;
    return Frame{r * out + minor * v.sin * z, side, glm::cross(d1 / speed, side),
                 glm::length(glm::cross(d1, d2)) / (speed * speed * speed)};
  };
  std::vector<Frame> frames(size_t(params.along));
  double curvature = 0.0;
  for (int i = 0; i < params.along; ++i) {
    frames[size_t(i)] = frame_at(i);
    curvature = std::max(curvature, frames[size_t(i)].curvature);
  }
  // Some hundred roundings of a float of the knot's size: a thinner tube would lose its roundness.
  const double thinnest = 0x1p-16 * (major + minor);
  require_range("knot", "--tube", params.tube, thinnest, 1.0 / curvature);
  require(params.tube * curvature < 1.0, "knot: --tube must be below the curve's smallest radius of curvature");

  const double tube = params.tube;
  std::vector<SinCos> ring(size_t(params.around));
  for (int j = 0; j < params.around; ++j) ring[size_t(j)] = sin_cos_turn(j, params.around);
  return build(grid, GridNormals::given, [&](int i, int j) {
    const Frame& f = frames[size_t(i)];
    // Minus, because tangent x up = -side: so d/du x d/dv points outwards.
    const DVec3 n = ring[size_t(j)].cos * f.side - ring[size_t(j)].sin * f.up;
    return SurfacePoint{f.position + tube * n, n};
  });
}

// ---------------------------------------------------------------- sphere, plane, cube

TriangleMesh make_sphere(const SphereParams& params) {
  require_range("sphere", "--radius", params.radius, k_min_size, k_max_size);
  require_count("sphere", "--around", params.around, 3, k_max_cells);
  require_count("sphere", "--along", params.along, 2, k_max_cells);
  const GridShape grid{params.around, params.along, true, false, true};
  require_triangles("sphere", triangle_count(grid));
  return build(grid, GridNormals::given, [&](int i, int j) {
    const SinCos theta = sin_cos_turn(i, params.around);
    const SinCos phi = sin_cos_turn(2 * int64_t(j) - params.along, 4 * int64_t(params.along));
    const DVec3 n(phi.cos * theta.cos, phi.cos * theta.sin, phi.sin);
    return SurfacePoint{double(params.radius) * n, n};
  });
}

TriangleMesh make_plane(const PlaneParams& params) {
  require_range("plane", "--half-size", params.half_size, k_min_size, k_max_size);
  require_count("plane", "--columns", params.columns, 1, k_max_cells);
  require_count("plane", "--rows", params.rows, 1, k_max_cells);
  const GridShape grid{params.columns, params.rows};
  require_triangles("plane", triangle_count(grid));
  const double s = params.half_size;
  return build(grid, GridNormals::given, [&](int i, int j) {
    return SurfacePoint{
        {s * double(2 * i - params.columns) / params.columns, s * double(2 * j - params.rows) / params.rows, 0.0},
        {0.0, 0.0, 1.0}};
  });
}

TriangleMesh make_cube(const CubeParams& params) {
  require_range("cube", "--half-size", params.half_size, k_min_size, k_max_size);
  require_count("cube", "--divisions", params.divisions, 1, 2048);
  const int n = params.divisions;
  const GridShape grid{n, n};
  require_triangles("cube", 6 * triangle_count(grid));
  // One odd function of i about the middle for every coordinate, so that faces meet bit for bit.
  const auto coordinate = [&](int i) { return double(params.half_size) * double(2 * i - n) / n; };
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    const int u_axis = (axis + 1) % 3, v_axis = (axis + 2) % 3;
    for (const int side : {1, -1}) {
      append(mesh, build(grid, GridNormals::given, [&](int i, int j) {
               SurfacePoint s;
               s.position[axis] = side * double(params.half_size);
               // Mirrored in u on the negative side, which reverses the winding.
               s.position[u_axis] = coordinate(side > 0 ? i : n - i);
               s.position[v_axis] = coordinate(j);
               s.normal[axis] = side;
               return s;
             }));
    }
  }
  return mesh;
}

}  // namespace fieldtrace
