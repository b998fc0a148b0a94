// Procedural meshes: sizes, closedness, orientation, normals, numerical extremes, rejection of bad parameters.
#include <gtest/gtest.h>

#include <random>

#include "core/mesh/mesh_normals.h"
#include "core/mesh/mesh_parts.h"
#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "core/platform/error.h"
#include "tests/support/mesh_checks.h"

namespace fieldtrace {
namespace {

using namespace mesh_checks;

// Normals are computed in double, rounded to float and normalised there: a handful of roundings.
constexpr double k_unit_bound = double(gamma_bound(6));

void expect_sound(const TriangleMesh& mesh) {
  EXPECT_TRUE(finite(mesh));
  EXPECT_LE(unit_error(mesh), k_unit_bound);
  EXPECT_EQ(mesh.normals.size(), mesh.positions.size());
  ASSERT_EQ(mesh.texcoords.size(), mesh.positions.size());
  for (const Vec2& t : mesh.texcoords) ASSERT_TRUE(t.x >= 0.0f && t.x <= 1.0f && t.y >= 0.0f && t.y <= 1.0f);
  std::vector<bool> used(mesh.positions.size(), false);
  for (const UVec3& t : mesh.triangles) {
    for (int c = 0; c < 3; ++c) {
      ASSERT_LT(t[c], mesh.positions.size());
      used[t[c]] = true;
    }
  }
}

template <class Function>
std::string usage_message(Function&& f) {
  try {
    f();
  } catch (const UsageError& e) {
    return e.what();
  }
  return "no error";
}

TEST(ProceduralMesh, ThesisSizesAreTheDefaults) {
  EXPECT_EQ(make_supershape().triangles.size(), 16128u);
  EXPECT_EQ(make_hyperboloid().triangles.size(), 16384u);
}

TEST(ProceduralMesh, DefaultsFitTheUnitSphereAndAreSound) {
  for (const TriangleMesh& mesh :
       {make_supershape(), make_hyperboloid(), make_knot(), make_sphere(), make_plane(), make_cube(), make_comb(),
        make_wire_globe(), make_hair_ball(), make_wavy_sheet(), make_holy_sphere(), make_sliver_fan()}) {
    expect_sound(mesh);
    const double r = farthest(mesh);
    EXPECT_LE(r, 1.0 + double(gamma_bound(4)));
    EXPECT_GE(r, 0.9);
  }
}

TEST(ProceduralMesh, ClosedShapesAreWatertightAndFaceOutwards) {
  struct Case {
    const char* name;
    TriangleMesh mesh;
    int64_t euler;
  };
  const Case cases[] = {{"supershape", make_supershape(), 2},
                        {"sphere", make_sphere(), 2},
                        {"coarsest sphere", make_sphere({.radius = 1.0f, .around = 3, .along = 2}), 2},
                        {"knot", make_knot(), 0},
                        {"torus", make_knot({.p = 1, .q = 0}), 0},
                        {"knot 5,3", make_knot({.p = 5, .q = 3, .tube = 0.05f, .along = 700, .around = 8}), 0},
                        {"cube", make_cube(), 2},
                        {"divided cube", make_cube({.half_size = 0.3f, .divisions = 7}), 2},
                        {"comb", make_comb(), 2 * 24},
                        {"hairs", make_hair_ball({.hairs = 50}), 2 * 50}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const Topology t = topology(c.mesh);
    EXPECT_TRUE(t.closed()) << t.border_edges << " border, " << t.bad_edges << " bad, " << t.degenerate
                            << " degenerate";
    EXPECT_EQ(t.euler(), c.euler);
    EXPECT_GT(volume(c.mesh), 0.0);
  }
}

TEST(ProceduralMesh, OpenShapesHaveTheBordersTheyShould) {
  const Topology hyperboloid = topology(make_hyperboloid());
  EXPECT_EQ(hyperboloid.border_edges, 2 * 128);
  EXPECT_EQ(hyperboloid.bad_edges, 0);
  EXPECT_EQ(hyperboloid.euler(), 0);
  const Topology plane = topology(make_plane({.half_size = 1.0f, .columns = 5, .rows = 3}));
  EXPECT_EQ(plane.border_edges, 2 * (5 + 3));
  EXPECT_EQ(plane.euler(), 1);
  EXPECT_GT(topology(make_holy_sphere()).border_edges, 0);
  EXPECT_EQ(topology(make_holy_sphere()).bad_edges, 0);
}

TEST(ProceduralMesh, NormalsLieOnTheFrontOfTheirTriangles) {
  for (const TriangleMesh& mesh : {make_hyperboloid(), make_knot(), make_sphere(), make_plane(), make_cube(),
                                   make_comb(), make_wire_globe(), make_wavy_sheet(), make_sliver_fan()}) {
    EXPECT_EQ(agreeing_corners(mesh), 1.0);
  }
  EXPECT_GE(agreeing_corners(make_supershape()), 0.999);
}

TEST(ProceduralMesh, SphereHasTheAreaAndVolumeOfASphere) {
  // A latitude-longitude grid falls short by O(h^2); 1.1 is the constant of the two h^2 terms, rounded up.
  const double h = 2.0 * 3.14159265358979 / 400;
  const TriangleMesh mesh = make_sphere({.radius = 2.0f, .around = 400, .along = 200});
  EXPECT_NEAR(area(mesh) / (16.0 * 3.14159265358979), 1.0, 1.1 * h * h);
  EXPECT_NEAR(volume(mesh) / (32.0 / 3.0 * 3.14159265358979), 1.0, 1.1 * h * h);
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    ASSERT_NEAR(glm::dot(mesh.positions[i], mesh.normals[i]), 2.0f, 2.0f * gamma_bound(8));
  }
}

TEST(ProceduralMesh, TorusHasTheAreaAndVolumeOfATorus) {
  // p = 1, q = 0 is a circle of radius major + minor.
  const TriangleMesh mesh =
      make_knot({.p = 1, .q = 0, .major = 0.5f, .minor = 0.2f, .tube = 0.15f, .along = 600, .around = 200});
  const double pi = 3.14159265358979, h = 2.0 * pi / 200;
  EXPECT_NEAR(area(mesh) / (4.0 * pi * pi * 0.7 * 0.15), 1.0, h * h);
  EXPECT_NEAR(volume(mesh) / (2.0 * pi * pi * 0.7 * 0.15 * 0.15), 1.0, h * h);
}

TEST(ProceduralMesh, CubeAndPlaneAreExact) {
  const TriangleMesh cube = make_cube({.half_size = 1.0f, .divisions = 3});
  EXPECT_EQ(cube.triangles.size(), 12u * 9u);
  EXPECT_NEAR(area(cube), 24.0, 24.0 * double(gamma_bound(8)));
  EXPECT_NEAR(volume(cube), 8.0, 8.0 * double(gamma_bound(8)));
  const TriangleMesh plane = make_plane({.half_size = 1.0f});
  EXPECT_EQ(plane.triangles.size(), 2u);
  EXPECT_EQ(area(plane), 4.0);
  for (size_t i = 0; i < plane.positions.size(); ++i) {
    EXPECT_EQ(plane.normals[i], Vec3(0.0f, 0.0f, 1.0f));
    EXPECT_EQ(plane.texcoords[i], Vec2(plane.positions[i]) * 0.5f + 0.5f);
  }
}

TEST(ProceduralMesh, HyperboloidLiesOnItsSurface) {
  const HyperboloidParams params;
  const double a = params.waist, c2 = 0.64 * 0.09 / (0.36 - 0.09);
  const TriangleMesh mesh = make_hyperboloid(params);
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    const DVec3 p(mesh.positions[i]);
    ASSERT_NEAR((p.x * p.x + p.y * p.y) / (a * a) - p.z * p.z / c2, 1.0, 8.0 * double(gamma_bound(8)));
    ASSERT_NEAR(glm::dot(DVec3(mesh.normals[i]), glm::normalize(DVec3(p.x / (a * a), p.y / (a * a), -p.z / c2))), 1.0,
                double(gamma_bound(8)));
  }
}

TEST(ProceduralMesh, CircularSupershapeIsASphere) {
  const Superformula circle;
  const TriangleMesh mesh = make_supershape({.longitude = circle, .latitude = circle});
  for (const Vec3& p : mesh.positions) ASSERT_NEAR(glm::length(p), 1.0f, gamma_bound(4));
  EXPECT_EQ(agreeing_corners(mesh), 1.0);
}

TEST(ProceduralMesh, KnotStaysSoundAtTwoMillionTriangles) {
  const TriangleMesh mesh =
      make_knot({.p = 3, .q = 7, .major = 0.6f, .minor = 0.3f, .tube = 0.02f, .along = 8000, .around = 125});
  EXPECT_EQ(mesh.triangles.size(), 2000000u);
  EXPECT_TRUE(finite(mesh));
  EXPECT_LE(unit_error(mesh), k_unit_bound);
  EXPECT_EQ(agreeing_corners(mesh), 1.0);
}

TEST(ProceduralMesh, EveryKnotHasTheVolumeOfItsTube) {
  // Pappus: the volume of a tube is its cross-section times the length of the curve.
  for (int p = 1; p <= 5; ++p) {
    for (int q = 0; q <= 5; ++q) {
      if (std::gcd(p, q) != 1) continue;
      SCOPED_TRACE(testing::Message() << p << "," << q);
      const KnotParams params{.p = p, .q = q, .major = 0.6f, .minor = 0.3f, .tube = 0.01f, .along = 2000, .around = 24};
      double length = 0.0;
      const int steps = 20000;
      for (int i = 0; i < steps; ++i) {  // speed of the curve, averaged over a period
        const double r = params.major + params.minor * std::cos(2.0 * double(k_pi) * q * i / steps);
        length += std::hypot(p * r, q * double(params.minor)) * 2.0 * double(k_pi) / steps;
      }
      const double area_of_24_gon = 0.5 * 24 * std::sin(2.0 * double(k_pi) / 24) * 1e-4;
      const TriangleMesh mesh = make_knot(params);
      EXPECT_NEAR(volume(mesh) / (area_of_24_gon * length), 1.0, 1e-3);  // chords: 2000 steps for up to 5 windings
      EXPECT_TRUE(topology(mesh).closed());
      EXPECT_EQ(agreeing_corners(mesh), 1.0);
    }
  }
}

TEST(ProceduralMesh, KnotHasNoTwistAtTheSeam) {
  // Every edge along the tube is about as long as the step between rings; a twisted seam would be much longer.
  const KnotParams params;
  const TriangleMesh mesh = make_knot(params);
  double longest = 0.0, sum = 0.0;
  for (const UVec3& t : mesh.triangles) {
    if (t.y != t.x + 1) continue;  // the triangle's first edge runs along the tube
    const double length = glm::length(mesh.positions[t.y] - mesh.positions[t.x]);
    longest = std::max(longest, length);
    sum += length;
  }
  EXPECT_LT(longest, 3.0 * sum / (params.along * params.around));
}

TEST(ProceduralMesh, SupershapeSurvivesEveryLegalParameter) {
  std::mt19937 rng(7);
  const auto uniform = [&] { return double(rng()) * 0x1p-32; };
  const auto pick = [&](double least, double most) {
    const double u = uniform();
    if (u < 0.15) return least;
    if (u > 0.85) return most;
    const double low = std::max(least, 1e-3);
    return low * std::pow(most / low, uniform());
  };
  for (int i = 0; i < 300; ++i) {
    SupershapeParams params;
    params.around = 3 + int(uniform() * 40);
    params.along = 2 + int(uniform() * 20);
    for (Superformula* f : {&params.longitude, &params.latitude}) {
      *f = {.m = pick(0, 1000),
            .n1 = pick(0.01, 1000),
            .n2 = pick(0, 1000),
            .n3 = pick(0, 1000),
            .a = pick(0.001, 1000),
            .b = pick(0.001, 1000)};
      if (i % 2) f->m = std::floor(f->m);
    }
    SCOPED_TRACE(i);
    const TriangleMesh mesh = make_supershape(params);
    expect_sound(mesh);
    EXPECT_NEAR(farthest(mesh), 1.0, double(gamma_bound(8)));
    const Topology t = topology(mesh);
    EXPECT_EQ(t.border_edges, 0);
    EXPECT_EQ(t.degenerate, 0);
    EXPECT_EQ(t.euler(), 2);
    EXPECT_GT(volume(mesh), 0.0);
  }
}

TEST(ProceduralMesh, ExtremeSizesStaySound) {
  for (const float size : {1e-6f, 1e6f}) {
    expect_sound(make_sphere({.radius = size}));
    expect_sound(make_cube({.half_size = size}));
    expect_sound(make_plane({.half_size = size}));
    expect_sound(make_supershape({.radius = size}));
    EXPECT_TRUE(topology(make_supershape({.radius = size})).closed());
  }
  expect_sound(make_hyperboloid({.waist = 1e-6f, .rim = 1e6f, .half_height = 1e6f}));
  expect_sound(make_hyperboloid({.waist = 1.0f, .rim = std::nextafter(1.0f, 2.0f), .half_height = 1e-6f}));
  expect_sound(make_knot({.p = 64, .q = 63, .major = 1.0f, .minor = 0.5f, .tube = 1e-4f}));
}

TEST(ProceduralMesh, IllegalParametersAreNamed) {
  const float nan = std::nanf("");
  EXPECT_EQ(usage_message([] { make_sphere({.radius = 1.0f, .around = 2}); }),
            "sphere: --around is 2, it must be between 3 and 32768");
  EXPECT_EQ(usage_message([] { make_sphere({.radius = -1.0f}); }),
            "sphere: --radius is -1, it must be between 1e-06 and 1e+06");
  EXPECT_NE(usage_message([&] { make_sphere({.radius = nan}); }), "no error");
  EXPECT_EQ(usage_message([] { make_supershape({.longitude = {.m = 4, .n1 = 0}}); }),
            "supershape: --n1 is 0, it must be between 0.01 and 1000");
  EXPECT_NE(usage_message([] { make_supershape({.latitude = {.m = -1}}); }).find("--m-lat is"), std::string::npos);
  EXPECT_EQ(usage_message([] { make_knot({.p = 2, .q = 4}); }),
            "knot: --p and --q have a common factor, divide both by it");
  EXPECT_NE(usage_message([] { make_knot({.tube = 5.0f}); }).find("tube"), std::string::npos);
  EXPECT_NE(usage_message([] { make_knot({.minor = 0.7f}); }).find("minor"), std::string::npos);
  EXPECT_NE(usage_message([] { make_knot({.along = 4000000, .around = 300}); }).find("lower the resolution"),
            std::string::npos);
  EXPECT_NE(usage_message([] { make_hyperboloid({.waist = 1.0f, .rim = 1.0f}); }).find("rim"), std::string::npos);
  EXPECT_NE(usage_message([] { make_cube({.half_size = k_infinity}); }).find("--half-size"), std::string::npos);
  EXPECT_NE(usage_message([] { make_plane({.columns = 0}); }).find("columns"), std::string::npos);
  EXPECT_NE(usage_message([] { make_comb({.solid_share = 1.0f}); }).find("--solid-share"), std::string::npos);
  EXPECT_NE(usage_message([] { make_wire_globe({.meridians = 0, .parallels = 0}); }), "no error");
  EXPECT_NE(usage_message([] { make_hair_ball({.hairs = 0}); }).find("hairs"), std::string::npos);
  EXPECT_NE(usage_message([] { make_holy_sphere({.holes = 1000, .hole_radius_degrees = 60}); }), "no error");
  EXPECT_EQ(usage_message([] { make_holy_sphere({.hole_radius_degrees = 70}); }),
            "holy sphere: --hole-radius is 70, it must be between 0 and 60");
}

TEST(StressMesh, HairBallDependsOnItsSeedAlone) {
  const HairBallParams params{.hairs = 20, .seed = 5};
  EXPECT_EQ(make_hair_ball(params).positions, make_hair_ball(params).positions);
  EXPECT_NE(make_hair_ball(params).positions, make_hair_ball({.hairs = 20, .seed = 6}).positions);
  EXPECT_EQ(make_hair_ball(params).triangles.size(), 20u * 6u * 4u);
}

TEST(StressMesh, ExtremeParametersStaySound) {
  for (const TriangleMesh& mesh :
       {make_comb({.slats = 10000, .solid_share = 0.05f}), make_comb({.slats = 1, .solid_share = 0.999f}),
        make_wire_globe({.meridians = 0, .parallels = 3, .wire_radius = 0.1f}),
        make_wire_globe({.meridians = 3, .parallels = 1000, .wire_radius = 1e-5f, .along = 16, .around = 3}),
        make_hair_ball({.hairs = 50, .segments = 64, .hair_radius = 1e-5f, .ball_radius = 0.9f, .bend = 1.0f}),
        make_hair_ball({.hairs = 50, .segments = 1, .hair_radius = 0.05f, .ball_radius = 0.05f, .bend = 0.0f}),
        make_wavy_sheet({.half_size = 0.7f, .amplitude = 0.15f, .waves = 1000.0f, .cells = 64}),
        make_wavy_sheet({.amplitude = 0.0f, .waves = 0.0f, .cells = 1}), make_holy_sphere({.holes = 0}),
        make_holy_sphere({.holes = 1, .hole_radius_degrees = 60.0f}),
        make_sliver_fan({.slivers = 1, .aspect = 0.1f})}) {
    expect_sound(mesh);
    EXPECT_EQ(topology(mesh).bad_edges, 0);
    EXPECT_EQ(topology(mesh).degenerate, 0);
    EXPECT_LE(farthest(mesh), 1.05);
  }
}

TEST(StressMesh, SliversAreAsThinAsAsked) {
  const TriangleMesh mesh = make_sliver_fan({.slivers = 100, .aspect = 1e-7f});
  for (const UVec3& t : mesh.triangles) {
    const double width = glm::length(mesh.positions[t.y] - mesh.positions[t.z]);
    const double length = glm::length(mesh.positions[t.y] - mesh.positions[t.x]);
    ASSERT_GT(width, 0.0);
    ASSERT_LT(width / length, 3e-7);
  }
}

// Copies of a mesh, moved and scaled, in one.
TriangleMesh joined(const TriangleMesh& mesh, const std::vector<std::pair<Vec3, float>>& places) {
  TriangleMesh all;
  for (const auto& [place, size] : places) {
    const auto first = uint32_t(all.positions.size());
    for (const Vec3& p : mesh.positions) all.positions.push_back(place + size * p);
    for (const UVec3& t : mesh.triangles) all.triangles.push_back(t + first);
  }
  return all;
}

// Every triangle with vertices of its own.
TriangleMesh faceted(const TriangleMesh& mesh) {
  TriangleMesh facets;
  for (const UVec3& t : mesh.triangles) {
    const auto first = uint32_t(facets.positions.size());
    for (int c = 0; c < 3; ++c) facets.positions.push_back(mesh.positions[t[c]]);
    facets.triangles.push_back(UVec3(first, first + 1, first + 2));
  }
  return facets;
}

TEST(MeshParts, SmallOnesAreFoundByTheirBoxes) {
  const TriangleMesh sphere = make_sphere({});
  const double diagonal = double(glm::length(sphere.bounds().diagonal()));
  // Radii 1, 1/2 and 1/4: areas as 16, 4 and 1.
  const TriangleMesh three = joined(sphere, {{Vec3(0), 1.0f}, {Vec3(3, 0, 0), 0.5f}, {Vec3(5, 0, 0), 0.25f}});
  for (const TriangleMesh& mesh : {three, faceted(three)}) {
    EXPECT_EQ(share_of_small_parts(mesh, float(0.2 * diagonal)), 0.0);
    EXPECT_NEAR(share_of_small_parts(mesh, float(0.4 * diagonal)), 1.0 / 21.0, 1e-6);
    EXPECT_NEAR(share_of_small_parts(mesh, float(0.7 * diagonal)), 5.0 / 21.0, 1e-6);
    EXPECT_NEAR(share_of_small_parts(mesh, float(2.0 * diagonal)), 1.0, 1e-12);
  }
  EXPECT_EQ(share_of_small_parts(TriangleMesh(), 1.0f), 0.0);
}

// Against parts that a search from triangle to triangle finds, in a soup of random triangles on few places.
TEST(MeshParts, AreWhatSharesPlaces) {
  std::mt19937 random(4);
  for (int round = 0; round < 50; ++round) {
    TriangleMesh mesh;
    const int places = 3 + int(random() % 60);
    std::vector<Vec3> at;
    for (int i = 0; i < places; ++i) at.push_back(Vec3(float(random() % 1000), float(random() % 1000), -0.0f));
    for (int i = 0; i < 90; ++i)
      mesh.positions.push_back(at[random() % at.size()] * Vec3(1.0f, 1.0f, i % 2 ? 1.0f : -1.0f));
    for (int i = 0; i < 25; ++i) mesh.triangles.push_back(UVec3(random() % 90, random() % 90, random() % 90));
    const size_t n = mesh.triangles.size();
    const auto touch = [&](size_t a, size_t b) {
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
          if (mesh.positions[mesh.triangles[a][i]] == mesh.positions[mesh.triangles[b][j]]) return true;
        }
      }
      return false;
    };
    std::vector<int> part(n, -1);
    double small = 0.0, all = 0.0;
    const float size = 900.0f;
    for (size_t seed = 0; seed < n; ++seed) {
      if (part[seed] >= 0) continue;
      std::vector<size_t> members = {seed};
      part[seed] = int(seed);
      for (size_t k = 0; k < members.size(); ++k) {
        for (size_t other = 0; other < n; ++other) {
          if (part[other] >= 0 || !touch(members[k], other)) continue;
          part[other] = int(seed);
          members.push_back(other);
        }
      }
      Bounds3 bounds;
      double area = 0.0;
      for (const size_t k : members) {
        const UVec3& t = mesh.triangles[k];
        const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
        for (const DVec3& p : {a, b, c}) bounds.extend(Vec3(p));
        area += glm::length(glm::cross(b - a, c - a));
      }
      all += area;
      if (glm::length(bounds.diagonal()) < size) small += area;
    }
    EXPECT_NEAR(share_of_small_parts(mesh, size), all > 0.0 ? small / all : 0.0, 1e-9) << round;
  }
}

TEST(VertexNormals, AreWeightedByAngle) {
  // Around a cube's corner the three faces must have equal weight however they are triangulated, unlike with area
  // weighting.
  TriangleMesh cube = make_cube({.half_size = 1.0f});
  const std::vector<uint32_t> weld = weld_positions(cube);
  const std::vector<Vec3> normals = vertex_normals(cube, weld);
  for (size_t i = 0; i < normals.size(); ++i) {
    EXPECT_LT(glm::length(normals[i] - glm::normalize(cube.positions[i])), gamma_bound(16));
  }
}

TEST(VertexNormals, SurviveFacetsThatCancelOrVanish) {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {5, 5, 5}, {2, 0, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 1}, {0, 1, 4}};  // both sides of one triangle, and one of zero area
  compute_vertex_normals(mesh);
  EXPECT_LE(unit_error(mesh), k_unit_bound);
  EXPECT_EQ(mesh.normals[0], Vec3(0.0f, 0.0f, 1.0f));
  EXPECT_EQ(mesh.normals[3], Vec3(0.0f, 0.0f, 1.0f));
}

TEST(VertexNormals, HoldForTinyMeshes) {
  TriangleMesh mesh = make_sphere({.radius = 1.0f, .around = 24, .along = 12});
  for (Vec3& p : mesh.positions) p *= 0x1p-90f;  // squared areas far below the smallest float
  const std::vector<Vec3> analytic = mesh.normals;
  mesh.normals = vertex_normals(mesh, weld_positions(mesh));
  for (size_t i = 0; i < analytic.size(); ++i) ASSERT_GT(glm::dot(analytic[i], mesh.normals[i]), 0.99f);
}

}  // namespace
}  // namespace fieldtrace
