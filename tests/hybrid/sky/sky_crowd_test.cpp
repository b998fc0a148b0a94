// Crowds under skies: far occluders read in groups against rays, and what the cost of a picture depends on.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "hybrid/sky/sky.h"
#include "hybrid/visibility/linear_map.h"
#include "tests/support/image_statistics.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::SceneMaker;

constexpr int k_side = 15;       // instances along each side of the crowd
constexpr float k_step = 0.9f;   // between them
constexpr int k_film = 2048;     // far larger than the window that tests render, so that maps pay
constexpr uint32_t k_first = 1;  // instance of the crowd

Mat3 random_turn(std::mt19937& random) {
  std::normal_distribution<float> normal;
  const Vec3 x = glm::normalize(Vec3(normal(random), normal(random), normal(random)));
  const Vec3 y = glm::normalize(glm::cross(x, Vec3(normal(random), normal(random), normal(random))));
  return Mat3(x, y, glm::cross(x, y));
}

// Turned objects over a floor: `side` x `side` instances, every seventh mirrored, every eleventh squashed.
struct Crowd : SceneMaker {
  explicit Crowd(int window, int side = k_side, int film_size = k_film, const TriangleMesh& of = knot()) {
    scene.sample_count = 1;
    scene.camera.to_world = look_at({0.5f, -6, 3.5f}, {0, 0, 0.3f}, {0, 0, 1});
    film(film_size, film_size);
    scene.camera.fov_x_degrees =
        float(2.0 * std::atan(std::tan(14.0 * M_PI / 180.0) * film_size / window) * 180.0 / M_PI);
    const uint32_t grey = bsdf(BsdfKind::diffuse, Rgb(0.5f));
    instance(shape(ShapeKind::rectangle), grey, test::scaling(Vec3(30.0f)));
    const uint32_t object = mesh(of);
    std::mt19937 random(7);
    std::uniform_real_distribution<float> shift(-0.15f, 0.15f), size(0.3f, 0.4f);
    for (int k = 0; k < side * side; ++k) {
      Mat3 m = random_turn(random) * size(random);
      if (k % 7 == 3) m[0] = -m[0];
      if (k % 11 == 5) m[2] *= 0.5f;
      const float x = float(k % side) - 0.5f * float(side - 1), y = float(k / side) - 0.5f * float(side - 1);
      const Vec3 at(k_step * x + shift(random), k_step * y + shift(random), 0.42f);
      instance(object, grey, Affine(m[0], m[1], m[2], at));
    }
    light(EmitterKind::constant, Rgb(2.0f));  // an open floor is 1
  }
  static TriangleMesh knot() { return make_knot({.along = 96, .around = 10}); }
};

// A forest's tree: small squares in a ball.
TriangleMesh crown() {
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  TriangleMesh leaves;
  for (uint32_t k = 0; k < 6000; ++k) {
    const Vec3 d(normal(random), normal(random), normal(random));
    const Vec3 at = d / glm::length(d) * std::cbrt(float(k + 1) / 6000.0f);
    const Mat3 m = random_turn(random) * 0.02f;
    for (const Vec3& corner : {-m[0] - m[1], m[0] - m[1], m[0] + m[1], m[1] - m[0]}) {
      leaves.positions.push_back(at + corner);
    }
    leaves.triangles.emplace_back(4 * k, 4 * k + 1, 4 * k + 2);
    leaves.triangles.emplace_back(4 * k, 4 * k + 2, 4 * k + 3);
  }
  return leaves;
}

RenderOptions options_for(const Crowd& crowd, Method method, int size, int spp, int light_samples) {
  RenderOptions o;
  o.method = method;
  o.spp = spp;
  o.light_samples = light_samples;
  o.seed = 1;
  o.threads = 2;
  const int margin = (crowd.scene.film.width - size) / 2;
  o.crop = Rect{margin, margin, size, size};
  o.aovs = {"object"};
  return o;
}

struct Error {
  double rmse = 0.0, bias = 0.0;
  size_t pixels = 0;
};

Error error_of(const Image& image, const Image& exact, bool of_floor) {
  const int channel = image.channel_index("object.Y");
  Error e;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const auto object = uint32_t(image.pixel(x, y)[channel]);
      if (object == 0 || (object - 1 < k_first) != of_floor) continue;
      const double d = double(image.pixel(x, y)[0]) - double(exact.pixel(x, y)[0]);
      e.rmse += d * d, e.bias += d;
      ++e.pixels;
    }
  }
  e.rmse = std::sqrt(e.rmse / double(e.pixels)), e.bias /= double(e.pixels);
  return e;
}

// What docs/decisions/026-crowds-under-skies.md states.
TEST(SkyCrowd, IsNearMonteCarlo) {
  constexpr int k_size = 64;
  const Crowd crowd(k_size);
  const Image exact = render(crowd.scene, options_for(crowd, Method::monte_carlo, k_size, 1, 1024)).image;
  const RenderResult r = render(crowd.scene, options_for(crowd, Method::hybrid, k_size, 1, 1024));
  EXPECT_EQ(r.stats.sky_directions, 16);
  for (const bool of_floor : {true, false}) {
    const Error e = error_of(r.image, exact, of_floor);
    EXPECT_GT(e.pixels, 500u);
    EXPECT_LT(e.rmse, of_floor ? 0.03 : 0.04) << of_floor;
    EXPECT_LT(std::abs(e.bias), 0.02) << of_floor;
  }
}

// With fewer than 4 light samples a pixel cells are wider: what they err by is a quarter of Monte Carlo's noise.
TEST(SkyCrowd, OfFewSamplesIsNearMonteCarlo) {
  constexpr int k_size = 64;
  const Crowd crowd(k_size);
  const Image exact = render(crowd.scene, options_for(crowd, Method::monte_carlo, k_size, 1, 1024)).image;
  const RenderResult r = render(crowd.scene, options_for(crowd, Method::hybrid, k_size, 1, 2));
  const Image noisy = render(crowd.scene, options_for(crowd, Method::monte_carlo, k_size, 1, 2)).image;
  EXPECT_EQ(r.stats.sky_directions, 8);
  EXPECT_EQ(render(crowd.scene, options_for(crowd, Method::hybrid, k_size, 1, 4)).stats.sky_directions, 16);
  for (const bool of_floor : {true, false}) {
    const Error e = error_of(r.image, exact, of_floor);
    EXPECT_LT(e.rmse, 0.25 * error_of(noisy, exact, of_floor).rmse) << of_floor;
    EXPECT_LT(std::abs(e.bias), 0.03) << of_floor;
  }
}

size_t differing(const Image& a, const Image& b, int dx, int dy) {
  size_t n = 0;
  for (int y = 0; y < b.height; ++y) {
    for (int x = 0; x < b.width; ++x) {
      for (int c = 0; c < 3; ++c) n += a.pixel(x + dx, y + dy)[c] != b.pixel(x, y)[c];
    }
  }
  return n;
}

TEST(SkyCrowd, DoesNotDependOnTheMachineOrTheWindow) {
  constexpr int k_size = 48;
  const Crowd crowd(k_size);
  for (const int spp : {1, 4}) {
    RenderOptions o = options_for(crowd, Method::hybrid, k_size, spp, 1);
    o.threads = 1;
    const RenderResult one = render(crowd.scene, o);
    EXPECT_GT(one.stats.sky_objects, 0u);
    o.threads = 4;
    for (const Isa isa : supported_isas()) {
      o.isa = isa;
      EXPECT_EQ(differing(one.image, render(crowd.scene, o).image, 0, 0), 0u) << isa_name(isa) << " " << spp;
    }
    o.isa = Isa::automatic;
    o.crop = Rect{o.crop->x + 5, o.crop->y + 7, 19, 16};
    EXPECT_EQ(differing(one.image, render(crowd.scene, o).image, 5, 7), 0u) << spp;
  }
}

// The number of instances in view decides, and whether maps can show what they are.
TEST(SkyCrowd, HasMapsWhereTheyPay) {
  constexpr int k_size = 16;
  const auto mapped = [](const Crowd& crowd, int light_samples) {
    return render(crowd.scene, options_for(crowd, Method::hybrid, k_size, 1, light_samples)).stats.sky_objects;
  };
  EXPECT_EQ(mapped(Crowd(128, 4 * k_side, 512), 1), 0u);
  EXPECT_EQ(mapped(Crowd(128, 4 * k_side, 512), 64), 2u);
  EXPECT_EQ(mapped(Crowd(k_size, k_side, k_film, crown()), 1), 0u);
  EXPECT_EQ(mapped(Crowd(k_size, 6, k_film, crown()), 1), 2u) << "no crowd";
}

SkyMaps maps_of(const Crowd& crowd) {
  const Accel accel(crowd.scene);
  const std::vector<ShapeTraits> traits = shape_traits(crowd.scene);
  const MappedShapes shapes = mapped_shapes(crowd.scene, traits);
  std::vector<std::shared_ptr<DirectionMaps>> maps;
  for (const MappedShape& of : shapes.shapes) {
    maps.push_back(std::make_unique<DirectionMaps>(of.ball, MapSize{16, 64}));
    BakeCounters counters;
    bake_maps(*maps.back(), accel, of.shape, glm::inverse(of.stretch), nullptr, counters);
  }
  return SkyMaps(crowd.scene, traits, shapes, std::move(maps), 16, {});
}

// That a lobe takes: three quarters of an ellipse.
double solid_angle(const GroupLobe& lobe) {
  return 0.75 * M_PI * double(lobe.height) /
         double(glm::length(glm::cross(Vec3(lobe.x[0], lobe.x[1], lobe.x[2]), Vec3(lobe.y[0], lobe.y[1], lobe.y[2]))));
}

// A far place sees nothing one by one, and lobes of the solid angle that rays find.
TEST(SkyCrowd, GroupsHideWhatTheirObjectsDo) {
  const Crowd crowd(64);
  const SkyMaps maps = maps_of(crowd);
  Scene objects = crowd.scene;
  objects.instances.erase(objects.instances.begin());
  const Accel accel(objects);
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform;
  for (const Vec3& at : {Vec3(0, 0, 60), Vec3(40, -30, 25), Vec3(-50, 3, 30)}) {
    std::vector<uint32_t> near;
    std::vector<GroupLobe> far;
    maps.find({at, 0.5f}, at, k_infinity, near, far);
    ASSERT_EQ(near.size(), 1u);  // the floor
    EXPECT_EQ(near[0], 0u);
    EXPECT_LT(far.size(), 100u);
    double sum = 0.0;
    for (const GroupLobe& lobe : far) sum += solid_angle(lobe);
    // Rays in a cone about all.
    const Vec3 axis = glm::normalize(-at), aside = glm::normalize(glm::cross(axis, Vec3(0.3f, 0.7f, 0.1f)));
    const float cosine = std::cos(std::asin(10.0f / glm::length(at)));
    constexpr size_t k_rays = 65536;
    RayBatch rays;
    rays.resize(k_rays);
    std::vector<uint32_t> indices(k_rays);
    AlignedVector<uint8_t> blocked(padded(k_rays), 0);
    for (size_t i = 0; i < k_rays; ++i) {
      const float c = 1.0f - uniform(random) * (1.0f - cosine), s = std::sqrt(1.0f - c * c);
      const float phi = 2.0f * k_pi * uniform(random);
      rays.set(i, at, axis * c + aside * (s * std::cos(phi)) + glm::cross(axis, aside) * (s * std::sin(phi)),
               k_infinity);
      indices[i] = uint32_t(i);
    }
    accel.occluded(rays, indices, blocked.data());
    const auto hits = double(std::count(blocked.begin(), blocked.begin() + k_rays, 1));
    const double hidden = hits / double(k_rays) * 2.0 * M_PI * (1.0 - double(cosine));
    EXPECT_NEAR(sum, hidden, 0.15 * hidden);
  }
}

// A closed hall of 256 panels: groups of them must not count as independent of each other.
TEST(SkyCrowd, HallsOfPanelsAreDark) {
  SceneMaker s;
  s.scene.camera.to_world = look_at({0, -3.5f, 2}, {0, 2, 1}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 70.0f;
  s.film(64, 64);
  const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.8f));
  s.scene.bsdfs[white].two_sided = true;
  const uint32_t square = s.shape(ShapeKind::rectangle);
  const auto panel = [&](const Vec3& x, const Vec3& y, const Vec3& at) {
    s.instance(square, white, Affine(0.5f * x, 0.5f * y, glm::cross(x, y), at));
  };
  const Vec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  for (int i = 0; i < 8; ++i) {
    const float a = float(i) - 3.5f;
    for (int j = 0; j < 8; ++j) {
      for (const float height : {0.0f, 4.0f}) panel(x, y, {a, float(j) - 3.5f, height});
    }
    for (int k = 0; k < 4; ++k) {
      for (const float side : {-4.0f, 4.0f}) {
        panel(x, z, {a, side, float(k) + 0.5f});
        panel(y, z, {side, a, float(k) + 0.5f});
      }
    }
  }
  s.light(EmitterKind::constant, Rgb(1.0f / 0.8f));
  RenderOptions o;
  o.method = Method::hybrid;
  o.spp = 16;
  o.directions = 32;
  o.threads = 2;
  const RenderResult r = render(s.scene, o);
  ASSERT_GT(r.stats.sky_directions, 0);
  EXPECT_LT(test::mean(r.image), 0.06);  // groups let in .3 of the sky
}

// A floor of 80 x 80 tiles across the grid's poles, most of it at grazing angles, hides all below the horizon.
TEST(SkyCrowd, FloorsOfTilesHideWhatOneFloorDoes) {
  constexpr int k_tiles = 80;
  SceneMaker s;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), tile = s.shape(ShapeKind::rectangle);
  const auto corner = [](int i) { return double(i - k_tiles / 2); };
  for (int i = 0; i < k_tiles; ++i) {
    for (int j = 0; j < k_tiles; ++j) {
      s.instance(tile, grey,
                 Affine(Vec3(0.5f, 0, 0), Vec3(0, 0.5f, 0), Vec3(0, 0, 1),
                        Vec3(float(corner(i)) + 0.5f, float(corner(j)) + 0.5f, 0)));
    }
  }
  const std::vector<ShapeTraits> traits = shape_traits(s.scene);
  const SkyMaps maps(s.scene, traits, mapped_shapes(s.scene, traits), {}, 16, {});
  const Vec3 at(0.3f, 0.2f, 0.5f);
  std::vector<uint32_t> near;
  std::vector<GroupLobe> far;
  maps.find({at, 0.1f}, at, k_infinity, near, far);
  const auto below = [&](double x, double y) {  // of a quadrant up to a corner at (x, y)
    x -= double(at.x), y -= double(at.y);
    return std::atan(x * y / (double(at.z) * std::sqrt(x * x + y * y + double(at.z) * double(at.z))));
  };
  const auto of_square = [&](int i, int j, int n) {
    const double x = corner(i), y = corner(j);
    return below(x + n, y + n) - below(x, y + n) - below(x + n, y) + below(x, y);
  };
  double sum = 0.0;
  for (const GroupLobe& lobe : far) sum += solid_angle(lobe);
  for (const uint32_t i : near) sum += of_square(int(i) / k_tiles, int(i) % k_tiles, 1);
  const double whole = of_square(0, 0, k_tiles);
  ASSERT_GT(whole, 6.0);
  EXPECT_NEAR(sum, whole, 0.03 * whole);
}

// What a place reads grows with what is near: 16 times the instances about it add groups alone.
TEST(SkyCrowd, CostAndMemoryAreBounded) {
  const Crowd small(64, k_side), large(64, 4 * k_side);
  const SkyMaps few = maps_of(small), many = maps_of(large);
  std::vector<uint32_t> near_few, near_many;
  std::vector<GroupLobe> far_few, far_many;
  const Sphere place{Vec3(0.1f, 0.2f, 0.4f), 0.4f};
  few.find(place, place.centre, k_infinity, near_few, far_few);
  many.find(place, place.centre, k_infinity, near_many, far_many);
  EXPECT_LT(near_few.size(), 80u);
  EXPECT_LT(near_many.size(), near_few.size() + 20u);
  EXPECT_LT(far_many.size(), 4 * far_few.size());
  constexpr size_t k_instance_bytes = 384;
  EXPECT_LT(many.bytes() - few.bytes(),
            k_instance_bytes * (large.scene.instances.size() - small.scene.instances.size()));
  const Sky sky(many, SkyRadiance(large.scene));
  EXPECT_EQ(&sky.cells_of(1), &sky.cells_of(2));  // one set for all
}

}  // namespace
}  // namespace fieldtrace
