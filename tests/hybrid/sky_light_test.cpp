// Sky light by direction maps in whole pictures: against Monte Carlo, and the same whatever the machine does.

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::SceneMaker;

constexpr float k_albedo = 0.5f;
// Maps are baked for what a whole film sends to the sky: it is far larger than the window that tests render.
// 2,048 samples a side of the film: D = 16 for up to two shapes; 4,096: D = 32.
constexpr int k_coarse = 2048, k_fine = 4096;

enum class Sky { constant, map, sun };

// Turns a map's +y to +z, and all of it a little about that.
Mat3 upright() {
  const float c = std::cos(0.7f), s = std::sin(0.7f);
  return Mat3(Vec3(c, s, 0), Vec3(0, 0, 1), Vec3(s, -c, 0));
}

// A floor under a sky whose mean radiance from above is about 2, so that it is about 1 in the open.
struct SkyScene : SceneMaker {
  uint32_t grey, floor;

  // A window of `size` pixels a side amid `film_size`.
  SkyScene(Sky sky, int size, int film_size) {
    scene.sample_count = 4;
    scene.camera.to_world = look_at({0, -7, 4}, {0, 0, 0.7f}, {0, 0, 1});
    film(film_size, film_size);
    // The window is what a film of its size sees at 28 degrees.
    const double widest = std::tan(0.5 * 28.0 * M_PI / 180.0) * film_size / size;
    scene.camera.fov_x_degrees = float(2.0 * std::atan(widest) * 180.0 / M_PI);
    grey = bsdf(BsdfKind::diffuse, Rgb(k_albedo));
    floor = instance(shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
    if (sky == Sky::constant) light(EmitterKind::constant, Rgb(1.0f / k_albedo));
    const int height = sky == Sky::map ? 33 : 129;
    const auto is_sun = [&](int x, int y) { return sky == Sky::sun && std::abs(x - 40) < 2 && std::abs(y - 35) < 2; };
    if (sky != Sky::constant) {
      environment(
          2 * height - 2, height,
          [&](int x, int y) {
            if (is_sun(x, y)) return Rgb(1.0f, 0.9f, 0.8f) * 600.0f;
            const float up = std::cos(k_pi * float(y) / float(height - 1));
            const float side = 1.0f + 0.8f * std::sin(2.0f * k_pi * float(x) / float(2 * height - 2));
            return Rgb(1.0f, 1.2f, 1.5f) * (up > 0.0f ? (1.0f + 2.0f * std::exp(-6.0f * up)) * side : 0.3f);
          },
          upright());
    }
  }
  void object(const TriangleMesh& m, const Affine& place) { instance(mesh(m), grey, place); }
};

TriangleMesh knot() { return make_knot({.along = 192, .around = 16}); }
TriangleMesh supershape() { return make_supershape({.around = 96, .along = 48}); }
Affine placed(const Mat3& m, const Vec3& at) { return Affine(m[0], m[1], m[2], at); }

// A rotation by 2 pi / 7 about an axis that is none of the grid's.
Mat3 turned() {
  const Vec3 a = glm::normalize(Vec3(1, 2, 3));
  const float c = std::cos(0.9f), s = std::sin(0.9f);
  Mat3 m(0.0f);
  for (int i = 0; i < 3; ++i) {
    Vec3 e(0.0f);
    e[i] = 1.0f;
    m[i] = e * c + glm::cross(a, e) * s + a * (glm::dot(a, e) * (1.0f - c));
  }
  return m;
}

RenderOptions options_for(const Scene& scene, Method method, int size, int spp, int light_samples) {
  RenderOptions o;
  o.method = method;
  o.spp = spp;
  o.light_samples = light_samples;
  o.seed = 1;
  o.threads = 2;
  const int margin = (scene.film.width - size) / 2;
  o.crop = Rect{margin, margin, size, size};
  o.aovs = {"object"};
  return o;
}

struct Difference {
  double rmse = 0.0, bias = 0.0, largest = 0.0;
  size_t pixels = 0;
};

// Over the pixels of instance `instance`, or of nothing.
Difference difference(const Image& a, const Image& b, uint32_t instance) {
  const int channel = a.channel_index("object.Y");
  Difference d;
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      if (uint32_t(a.pixel(x, y)[channel]) != instance + 1) continue;
      ++d.pixels;
      for (int c = 0; c < 3; ++c) {
        const double error = double(a.pixel(x, y)[c]) - double(b.pixel(x, y)[c]);
        d.rmse += error * error, d.bias += error, d.largest = std::max(d.largest, std::abs(error));
      }
    }
  }
  d.rmse = std::sqrt(d.rmse / double(3 * d.pixels)), d.bias /= double(3 * d.pixels);
  return d;
}

void print(const char* name, const Difference& d) {
  printf("  %s: %zu pixels rmse %.5f bias %.5f largest %.4f\n", name, d.pixels, d.rmse, d.bias, d.largest);
}

class SkyPicture : public testing::TestWithParam<Sky> {};

TEST_P(SkyPicture, IsNearMonteCarlo) {
  constexpr int k_size = 32;
  for (const bool is_knot : {true, false}) {
    for (const int film : {k_coarse / 2, k_fine / 2}) {
      SkyScene s(GetParam(), k_size, film);
      s.object(is_knot ? knot() : supershape(), test::translation({0, 0, 1.05f}));
      const RenderResult exact = render(s.scene, options_for(s.scene, Method::monte_carlo, k_size, 4, 1024));
      RenderOptions o = options_for(s.scene, Method::monte_carlo, k_size, 4, 1024);
      o.seed = 2;
      const RenderResult again = render(s.scene, o);
      const RenderResult r = render(s.scene, options_for(s.scene, Method::hybrid, k_size, 4, 1));
      const RenderResult r64 = render(s.scene, options_for(s.scene, Method::hybrid, k_size, 4, 64));
      printf("%s film %d bake %g\n", is_knot ? "knot" : "supershape", film, double(r.stats.bake_rays));
      printf("  rays %llu of %llu\n", (unsigned long long)r64.stats.rays_exact, (unsigned long long)exact.stats.rays_exact);
      print("floor 1 ", difference(r.image, exact.image, 0));
      print("object 1", difference(r.image, exact.image, 1));
      print("floor 64 ", difference(r64.image, exact.image, 0));
      print("object 64", difference(r64.image, exact.image, 1));
      print("floor noise", difference(again.image, exact.image, 0));
      print("object noise", difference(again.image, exact.image, 1));
    }
  }
}

size_t differing(const Image& a, const Image& b) {
  if (a.data.size() != b.data.size()) return std::max(a.data.size(), b.data.size());
  size_t n = 0;
  for (size_t i = 0; i < a.data.size(); ++i) n += a.data[i] != b.data[i];
  return n;
}

struct Samples {
  int spp, light_samples, film;  // the film's side, for coarse maps
};
constexpr Samples k_samples[] = {{1, 1, k_coarse}, {4, 1, k_coarse / 2}, {1, 16, k_coarse / 4}, {64, 1, k_coarse / 8}};

// Two objects, one of them of smooth metal beside the other, on a floor.
SkyScene two_objects(Sky sky, int size, int film) {
  SkyScene s(sky, size, film);
  s.object(supershape(), test::translation({-0.7f, 0, 0.9f}));
  s.instance(s.mesh(knot()), s.grey, placed(turned() * 0.8f, {0.9f, -0.3f, 0.9f}));
  return s;
}

TEST_P(SkyPicture, AtToleranceZeroIsMonteCarlo) {
  for (const Samples& n : k_samples) {
    const SkyScene s = two_objects(GetParam(), 24, n.film);
    RenderOptions o = options_for(s.scene, Method::hybrid, 24, n.spp, n.light_samples);
    o.tolerance = 0.0f;
    const RenderResult r = render(s.scene, o);
    EXPECT_EQ(r.stats.bake_rays, 0u);
    o.method = Method::monte_carlo;
    EXPECT_EQ(differing(r.image, render(s.scene, o).image), 0u);
  }
}

TEST_P(SkyPicture, DoesNotDependOnTheMachineOrTheWindow) {
  constexpr int k_size = 28;
  for (const Samples& n : k_samples) {
    const SkyScene s = two_objects(GetParam(), k_size, n.film);
    RenderOptions o = options_for(s.scene, Method::hybrid, k_size, n.spp, n.light_samples);
    o.threads = 1;
    const RenderResult one = render(s.scene, o);
    EXPECT_GT(one.stats.bake_rays, 0u);
    o.threads = 4;
    for (const Isa isa : supported_isas()) {
      o.isa = isa;
      const RenderResult r = render(s.scene, o);
      EXPECT_EQ(differing(one.image, r.image), 0u) << isa_name(isa) << " " << n.spp << " " << n.light_samples;
      EXPECT_EQ(one.stats.rays_exact, r.stats.rays_exact);
    }
    o.isa = Isa::automatic;
    o.crop = Rect{o.crop->x + 5, o.crop->y + 7, 19, 16};
    const Image part = render(s.scene, o).image;
    size_t different = 0;
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        for (int c = 0; c < 3; ++c) different += part.pixel(x, y)[c] != one.image.pixel(x + 5, y + 7)[c];
      }
    }
    EXPECT_EQ(different, 0u) << n.spp << " " << n.light_samples;
  }
}

TEST_P(SkyPicture, OfTransformedInstancesIsNearMonteCarlo) {
  constexpr int k_size = 32;
  const Mat3 squash(Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 0.4f)), mirror(Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1));
  SkyScene s(GetParam(), k_size, k_fine / 2);
  const uint32_t shape = s.mesh(knot());
  s.instance(shape, s.grey, placed(turned() * 0.7f, {-1.1f, 0.3f, 0.9f}));
  s.instance(shape, s.grey, placed(turned() * mirror * 0.6f, {0.9f, -0.7f, 0.7f}));
  s.instance(shape, s.grey, placed(turned() * squash * 0.7f, {0.6f, 1.3f, 0.8f}));
  const RenderResult exact = render(s.scene, options_for(s.scene, Method::monte_carlo, k_size, 4, 1024));
  RenderOptions o = options_for(s.scene, Method::monte_carlo, k_size, 4, 1024);
  o.seed = 2;
  const RenderResult again = render(s.scene, o);
  const RenderResult r = render(s.scene, options_for(s.scene, Method::hybrid, k_size, 4, 64));
  for (uint32_t i = 0; i < 4; ++i) {
    print(("instance " + std::to_string(i)).c_str(), difference(r.image, exact.image, i));
    print("  noise", difference(again.image, exact.image, i));
  }
}

INSTANTIATE_TEST_SUITE_P(Skies, SkyPicture, testing::Values(Sky::constant, Sky::map, Sky::sun),
                         [](const auto& instance) {
                           return std::string(instance.param == Sky::constant ? "constant"
                                              : instance.param == Sky::map    ? "map"
                                                                              : "sun");
                         });

}  // namespace
}  // namespace fieldtrace
