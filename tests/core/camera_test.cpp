// Camera rays against values of Mitsuba 3.9, and the pixel filters' distributions.

#include "core/camera/camera.h"

#include <gtest/gtest.h>

#include "core/platform/error.h"
#include "core/sampling/sobol.hd.h"

namespace fieldtrace {
namespace {

Film small_film() {
  Film film;
  film.width = 32;
  film.height = 20;
  film.crop = {4, 6, 16, 8};
  return film;
}

Camera small_camera() {
  Camera camera;
  camera.fov_x_degrees = 40.0f;
  camera.near_clip = 0.5f;
  camera.far_clip = 100.0f;
  return camera;
}

void expect_near(const Vec3& a, const Vec3& b, float tolerance) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance);
}

// The crop window's top left corner, centre and bottom right corner.
TEST(Camera, PerspectiveAgreesWithReference) {
  Camera camera = small_camera();
  camera.principal_offset = {0.1f, -0.2f};
  const CameraSampler sampler(camera, small_film());
  const CameraRay a = sampler.ray_at({4, 6}, {}), b = sampler.ray_at({12, 10}, {}), c = sampler.ray_at({20, 14}, {});
  expect_near(a.origin, {.1000918f, .0909926f, .5f}, 1e-6f);
  expect_near(a.direction, {.1932368f, .1756698f, .9652977f}, 1e-6f);
  EXPECT_NEAR(a.tmax, 103.07701f, 1e-4f);
  expect_near(b.direction, {.0181207f, .0906033f, .9957222f}, 1e-6f);
  expect_near(c.origin, {-.0818933f, 0, .5f}, 1e-6f);
  expect_near(c.direction, {-.1616329f, 0, .9868509f}, 1e-6f);
}

TEST(Camera, ThinLensAgreesWithReference) {
  Camera camera = small_camera();
  camera.aperture_radius = 0.2f;
  camera.focus_distance = 3.0f;
  const CameraSampler sampler(camera, small_film());
  // Both programs map the lens sample (0.3, 0.7) by the same concentric map.
  const CameraRay a = sampler.ray_at({4, 6}, {.3f, .7f}), b = sampler.ray_at({12, 10}, {.3f, .7f});
  expect_near(a.origin, {.0893484f, .0926367f, .5f}, 1e-6f);
  expect_near(a.direction, {.2794786f, .0690824f, .9576634f}, 1e-6f);
  EXPECT_NEAR(a.tmax, 103.89871f, 1e-4f);
  expect_near(b.origin, {-.0016442f, .0471405f, .5f}, 1e-6f);
  expect_near(b.direction, {.1091728f, -.0187401f, .9938462f}, 1e-6f);
}

TEST(Camera, UniformScaleKeepsTheRaysUnit) {
  Camera camera = small_camera();
  camera.to_world = Affine(Vec3(2, 0, 0), Vec3(0, 2, 0), Vec3(0, 0, 2), Vec3(1, 2, 3));
  const CameraRay r = CameraSampler(camera, small_film()).ray_at({0, 0}, {});
  EXPECT_NEAR(glm::length(r.direction), 1.0f, 1e-6f);
  EXPECT_NEAR(r.origin.z, 4.0f, 1e-6f);
  EXPECT_NEAR(r.near_distance, glm::length(r.origin - Vec3(1, 2, 3)), 1e-5f);
}

// Mean of x^2 under the filter, by quadrature of its definition; odd moments vanish by symmetry.
double second_moment(const Film& film) {
  double up = 0.0, down = 0.0;
  const double r = film.filter_radius, s = film.gaussian_stddev;
  for (int i = 0; i < 200000; ++i) {
    const double x = r * (i + 0.5) / 200000;
    double f = 1.0;
    if (film.filter == FilterKind::tent) f = 1.0 - x / r;
    if (film.filter == FilterKind::gaussian) f = std::exp(-x * x / (2 * s * s)) - std::exp(-r * r / (2 * s * s));
    up += f * x * x;
    down += f;
  }
  return up / down;
}

TEST(Camera, FilterOffsetsFollowTheFilter) {
  for (const FilterKind kind : {FilterKind::box, FilterKind::tent, FilterKind::gaussian}) {
    Film film = small_film();
    film.filter = kind;
    film.filter_radius = kind == FilterKind::gaussian ? 2.0f : 0.8f;
    const CameraSampler sampler(small_camera(), film);
    double first = 0.0, second = 0.0;
    constexpr int n = 1 << 16;
    for (int i = 0; i < n; ++i) {
      const double x = sampler.filter_offset((float(i) + 0.5f) / n);
      ASSERT_LE(std::abs(x), film.filter_radius);
      first += x / n;
      second += x * x / n;
    }
    EXPECT_NEAR(first, 0.0, 1e-6);
    EXPECT_NEAR(second, second_moment(film), 1e-3 * second) << int(kind);
    EXPECT_LE(std::abs(sampler.filter_offset(0.0f)), film.filter_radius);
    EXPECT_LE(std::abs(sampler.filter_offset(1.0f - 0x1p-24f)), film.filter_radius);
    EXPECT_NEAR(sampler.filter_offset(0.5f), 0.0f, 1e-6f);
  }
}

// Every filter, with and without a lens, for batches that fill whole vectors and batches that do not.
TEST(Camera, RaysOfABatchAreThoseOfSinglePointsOnEveryMachine) {
  Camera camera = small_camera();
  camera.to_world = Affine(Vec3(0, 2, 0), Vec3(-2, 0, 0), Vec3(0, 0, 2), Vec3(1, -2, 3));
  camera.principal_offset = {0.1f, -0.2f};
  Film film = small_film();
  constexpr uint32_t k_seed = 77;
  for (const FilterKind kind : {FilterKind::box, FilterKind::tent, FilterKind::gaussian}) {
    for (const float aperture : {0.0f, 0.3f}) {
      film.filter = kind;
      camera.aperture_radius = aperture;
      const CameraSampler sampler(camera, film);
      for (const size_t count : {size_t(1), size_t(16), size_t(45), size_t(200)}) {
        CameraSamples samples;
        samples.resize(count);
        // The largest batch has whole vectors in one pixel, and neighbours that differ in one coordinate alone.
        const bool in_runs = count == 200;
        for (size_t i = 0; i < count; ++i) {
          const size_t x = in_runs ? 5 + i / 64 : i * 7 % 32, y = in_runs ? 3 + i / 48 : i * 5 % 20;
          samples.set(i, uint32_t(x), uint32_t(y), uint32_t(i * i), uint32_t(in_runs ? i / 96 : i % 3));
        }
        for (const Isa isa : supported_isas()) {
          RayBatch rays;
          AlignedVector<float> near_distance;
          SampleSeeds seeds;
          sampler.sample(samples, k_seed, isa, rays, near_distance, seeds);
          ASSERT_EQ(rays.size, count);
          for (size_t i = 0; i < count; ++i) {
            const uint32_t sequence = samples.replicate[i];
            const uint32_t of_sequence = sequence == 0 ? k_seed : scalar::hash_combine(k_seed, sequence);
            const uint32_t of_pixel = scalar::pixel_seed(of_sequence, samples.x[i], samples.y[i]);
            ASSERT_EQ(seeds.pixel[i], of_pixel) << isa_name(isa);
            ASSERT_EQ(seeds.vertex[i], scalar::vertex_seed(of_pixel, 0)) << isa_name(isa);
            const uint32_t seed = scalar::vertex_seed(of_pixel, k_camera_stream);
            const auto u = scalar::sample_2d(samples.index[i], seed, 0);
            const auto v = scalar::sample_2d(samples.index[i], seed, 1);
            const Vec2 at(float(samples.x[i]) + 0.5f + sampler.filter_offset(u.x),
                          float(samples.y[i]) + 0.5f + sampler.filter_offset(u.y));
            const CameraRay expected = sampler.ray_at(at, {v.x, v.y});
            ASSERT_EQ(rays.origin(i), expected.origin) << isa_name(isa);
            ASSERT_EQ(rays.direction(i), expected.direction) << isa_name(isa);
            ASSERT_EQ(rays.tmax[i], expected.tmax) << isa_name(isa);
            ASSERT_EQ(near_distance[i], expected.near_distance) << isa_name(isa);
          }
          for (size_t i = count; i < padded(count); ++i) ASSERT_LT(rays.tmax[i], 0.0f);
        }
      }
    }
  }
}

TEST(Camera, RejectsImpossibleCameras) {
  Film film = small_film();
  Camera camera = small_camera();
  camera.fov_x_degrees = 180.0f;
  EXPECT_THROW(CameraSampler(camera, film), Error);
  camera = small_camera();
  camera.near_clip = 0.0f;
  EXPECT_THROW(CameraSampler(camera, film), Error);
  camera = small_camera();
  camera.aperture_radius = 0.1f;
  camera.focus_distance = 0.0f;
  EXPECT_THROW(CameraSampler(camera, film), Error);
  film.width = 0;
  EXPECT_THROW(CameraSampler(small_camera(), film), Error);
}

}  // namespace
}  // namespace fieldtrace
