#include "core/mesh/mesh_stress.h"

#include <algorithm>
#include <random>

#include "core/math/frame.h"
#include "core/mesh/mesh_grid.h"
#include "core/mesh/mesh_procedural.h"

namespace fieldtrace {
namespace {

using namespace mesh_grid;

constexpr double k_pi_d = 3.14159265358979323846;

// Torus: a closed tube around a circle about `axis`.
TriangleMesh ring(const DVec3& centre, const DVec3& axis, double circle_radius, double wire_radius, int along,
                  int around) {
  const DMat3 basis = basis_about(axis);
  const DVec3 x = basis[0], y = basis[1];
  const GridShape grid{along, around, true, true, false};
  return build(grid, GridNormals::given, [&](int i, int j) {
    const double u = 2.0 * k_pi_d * i / along, v = 2.0 * k_pi_d * j / around;
    const DVec3 out = std::cos(u) * x + std::sin(u) * y;
    const DVec3 n = std::cos(v) * out + std::sin(v) * axis;
    return SurfacePoint{centre + circle_radius * out + wire_radius * n, n};
  });
}

// Uniform in [0, 1), identical on every platform (unlike the standard library's distributions).
class Random {
 public:
  explicit Random(uint32_t seed) : engine_(seed) {}
  double uniform() { return double(engine_()) * 0x1p-32; }
  DVec3 direction() {
    const double z = 1.0 - 2.0 * uniform(), phi = 2.0 * k_pi_d * uniform();
    const double r = std::sqrt(std::max(0.0, (1.0 - z) * (1.0 + z)));
    return {r * std::cos(phi), r * std::sin(phi), z};
  }

 private:
  std::mt19937 engine_;
};

}  // namespace

TriangleMesh make_comb(const CombParams& params) {
  require_count("comb", "--slats", params.slats, 1, 100000);
  require_range("comb", "--solid-share", params.solid_share, 1e-4, 1.0);
  require(params.solid_share < 1.0f, "comb: --solid-share must be below 1, else the slats touch");
  constexpr double k_half = 0.55;
  // 32 roundings of a float near 1 keep the two faces of a slat apart.
  require(2.0 * k_half / params.slats * params.solid_share >= 0x1p-19,
          "comb: the slats are thinner than floats can tell, lower --slats or raise --solid-share");
  const TriangleMesh cube = make_cube({.half_size = 1.0f});
  const double pitch = 2.0 * k_half / params.slats;
  TriangleMesh mesh;
  for (int i = 0; i < params.slats; ++i) {
    TriangleMesh slat = cube;
    const double y = -k_half + pitch * (i + 0.5), h = 0.5 * pitch * params.solid_share;
    for (Vec3& p : slat.positions) p = Vec3(DVec3(k_half * p.x, y + h * p.y, k_half * p.z));
    append(mesh, slat);
  }
  return mesh;
}

TriangleMesh make_wire_globe(const WireGlobeParams& params) {
  require_count("wire globe", "--meridians", params.meridians, 0, 1000);
  require_count("wire globe", "--parallels", params.parallels, 0, 1000);
  require(params.meridians + params.parallels > 0, "wire globe: --meridians or --parallels must be positive");
  require_range("wire globe", "--wire-radius", params.wire_radius, 1e-5, 0.1);
  require_count("wire globe", "--along", params.along, 8, 32768);
  require_count("wire globe", "--around", params.around, 3, 256);
  require_triangles("wire globe", 2 * uint64_t(params.along) * uint64_t(params.around) *
                                      uint64_t(params.meridians + params.parallels));
  const double wire = params.wire_radius, radius = 1.0 - wire;
  TriangleMesh mesh;
  for (int i = 0; i < params.meridians; ++i) {
    const double a = k_pi_d * i / params.meridians;
    append(mesh, ring(DVec3(0.0), {std::cos(a), std::sin(a), 0.0}, radius, wire, params.along, params.around));
  }
  for (int i = 0; i < params.parallels; ++i) {
    const double latitude = k_pi_d * (double(i + 1) / (params.parallels + 1) - 0.5);
    // Next to the poles a ring must stay wider than its wire.
    const double r = std::max(radius * std::cos(latitude), 2.0 * wire);
    append(mesh, ring({0.0, 0.0, radius * std::sin(latitude)}, {0.0, 0.0, 1.0}, r, wire, params.along, params.around));
  }
  return mesh;
}

TriangleMesh make_hair_ball(const HairBallParams& params) {
  require_count("hair ball", "--hairs", params.hairs, 1, 1000000);
  require_count("hair ball", "--segments", params.segments, 1, 64);
  require_range("hair ball", "--hair-radius", params.hair_radius, 1e-5, 0.05);
  require_range("hair ball", "--ball-radius", params.ball_radius, 0.05, 0.9);
  require_range("hair ball", "--bend", params.bend, 0.0, 1.0);
  constexpr int k_sides = 3;
  const GridShape grid{k_sides, params.segments + 1, true, false, true};
  require_triangles("hair ball", uint64_t(params.hairs) * triangle_count(grid));

  constexpr double k_tip_distance = 0.95;
  Random random(params.seed);
  TriangleMesh mesh;
  for (int hair = 0; hair < params.hairs; ++hair) {
    const DVec3 root = random.direction(), drift = random.direction();
    // At distance r along the hair: the root's direction, bent quadratically towards a random tangent.
    const DVec3 side = drift - glm::dot(drift, root) * root;
    const double length = (k_tip_distance - params.ball_radius) * (0.7 + 0.3 * random.uniform());
    const auto centre = [&](double s) {
      const double r = params.ball_radius + s * length;
      return r * glm::normalize(root + double(params.bend) * length * s * s * side);
    };
    const DMat3 basis = basis_about(root);
    const DVec3 x = basis[0], y = basis[1];
    // Row 0 is the centre of the root's cap, the last row the tip; the rings in between taper linearly.
    append(mesh, build(grid, GridNormals::smooth, [&](int i, int j) {
             if (j == 0) return SurfacePoint{centre(0.0), -root};
             const double s = double(j - 1) / params.segments;
             const double r = params.hair_radius * (1.0 - s), phi = 2.0 * k_pi_d * i / k_sides;
             return SurfacePoint{centre(s) + r * (std::cos(phi) * x + std::sin(phi) * y), root};
           }));
  }
  return mesh;
}

TriangleMesh make_wavy_sheet(const WavySheetParams& params) {
  require_range("wavy sheet", "--half-size", params.half_size, 0.01, 0.7);
  require_range("wavy sheet", "--amplitude", params.amplitude, 0.0, 0.15);
  require_range("wavy sheet", "--waves", params.waves, 0.0, 1000.0);
  require_count("wavy sheet", "--cells", params.cells, 1, 4096);
  const GridShape grid{params.cells, params.cells};
  const double s = params.half_size, a = params.amplitude, k = k_pi_d * params.waves / s;
  return build(grid, GridNormals::given, [&](int i, int j) {
    const double x = s * double(2 * i - params.cells) / params.cells;
    const double y = s * double(2 * j - params.cells) / params.cells;
    return SurfacePoint{{x, y, a * std::sin(k * x) * std::cos(k * y)},
                        {-a * k * std::cos(k * x) * std::cos(k * y), a * k * std::sin(k * x) * std::sin(k * y), 1.0}};
  });
}

TriangleMesh make_holy_sphere(const HolySphereParams& params) {
  require_count("holy sphere", "--holes", params.holes, 0, 1000);
  require_range("holy sphere", "--hole-radius", params.hole_radius_degrees, 0.0, 60.0);
  TriangleMesh mesh = make_sphere({.radius = 1.0f, .around = params.around, .along = params.along});

  // Hole centres on a Fibonacci spiral.
  std::vector<DVec3> holes;
  const double golden_angle = k_pi_d * (3.0 - std::sqrt(5.0));
  for (int i = 0; i < params.holes; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / params.holes, r = std::sqrt((1.0 - z) * (1.0 + z));
    holes.push_back({r * std::cos(golden_angle * i), r * std::sin(golden_angle * i), z});
  }
  const double limit = std::cos(params.hole_radius_degrees * k_pi_d / 180.0);
  std::erase_if(mesh.triangles, [&](const UVec3& t) {
    const DVec3 c = DVec3(mesh.positions[t.x]) + DVec3(mesh.positions[t.y]) + DVec3(mesh.positions[t.z]);
    const double length = glm::length(c);
    return std::any_of(holes.begin(), holes.end(), [&](const DVec3& h) { return glm::dot(c, h) > limit * length; });
  });
  require(!mesh.triangles.empty(), "holy sphere: the holes leave nothing, make them fewer or smaller");
  return mesh;
}

TriangleMesh make_sliver_fan(const SliverFanParams& params) {
  require_count("sliver fan", "--slivers", params.slivers, 1, 1000000);
  require_range("sliver fan", "--aspect", params.aspect, 1e-7, 0.1);
  constexpr double k_half_length = 0.9;
  const DVec3 tip(-k_half_length, 0.0, 0.0);
  TriangleMesh mesh;
  for (int i = 0; i < params.slivers; ++i) {
    // The far ends lie on a circle of radius 0.4 around the x axis; each sliver's width runs along that circle.
    const double phi = k_pi_d * (i + 0.5) / params.slivers;
    const DVec3 out(0.0, std::cos(phi), std::sin(phi)), across(0.0, -std::sin(phi), std::cos(phi));
    const DVec3 end = DVec3(k_half_length, 0.0, 0.0) + 0.4 * out;
    const DVec3 half_width = 0.5 * double(params.aspect) * glm::length(end - tip) * across;
    const DVec3 n = glm::normalize(glm::cross(end - half_width - tip, end + half_width - tip));
    const uint32_t base = uint32_t(mesh.positions.size());
    for (const DVec3& p : {tip, end - half_width, end + half_width}) {
      mesh.positions.push_back(Vec3(p));
      mesh.normals.push_back(glm::normalize(Vec3(n)));
    }
    mesh.texcoords.insert(mesh.texcoords.end(), {Vec2(0.5f, 0.0f), Vec2(0.0f, 1.0f), Vec2(1.0f, 1.0f)});
    mesh.triangles.push_back({base, base + 1, base + 2});
  }
  return mesh;
}

}  // namespace fieldtrace
