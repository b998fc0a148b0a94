#include "core/camera/camera.h"

#include <algorithm>
#include <cmath>

#include "core/camera/camera_batch-inl.h"
#include "core/platform/error.h"
#include "core/simd/vec_lanes.h"

namespace fieldtrace {
namespace {

// Size of the inverse-CDF table. Linear interpolation moves a sample by less than 1e-3 pixels, except in the outermost
// step, whose probability is 1 / 2048.
constexpr int k_gaussian_steps = 2048;

// Mitsuba's gaussian is shifted to reach zero at the radius: exp(-x^2 / 2 s^2) - exp(-r^2 / 2 s^2). This is its
// integral from 0 to x.
double gaussian_integral(double x, double radius, double stddev) {
  const double base = std::exp(-radius * radius / (2.0 * stddev * stddev));
  return stddev * std::sqrt(0.5 * 3.14159265358979323846) * std::erf(x / (stddev * std::sqrt(2.0))) - base * x;
}

// Tabulates the inverse CDF of |x| by bisection.
std::vector<float> tabulate_gaussian(double radius, double stddev) {
  std::vector<float> table(k_gaussian_steps + 1);
  const double total = gaussian_integral(radius, radius, stddev);
  double low = 0.0;
  for (int k = 0; k <= k_gaussian_steps; ++k) {
    const double target = total * k / k_gaussian_steps;
    double high = radius;
    double a = low;
    // 40 bisection steps narrow x to 1e-12 of the radius.
    for (int step = 0; step < 40; ++step) {
      const double middle = 0.5 * (a + high);
      (gaussian_integral(middle, radius, stddev) < target ? a : high) = middle;
    }
    low = a;
    table[k] = float(0.5 * (a + high));
  }
  table.front() = 0.0f;
  table.back() = float(radius);
  return table;
}

}  // namespace

CameraSampler::CameraSampler(const Camera& camera, const Film& film) {
  if (film.width < 1 || film.height < 1)
    throw Error("the film has no pixels (" + std::to_string(film.width) + " x " + std::to_string(film.height) +
                "); give it a width and a height of at least 1");
  if (!(camera.fov_x_degrees > 0.0f && camera.fov_x_degrees < 180.0f))
    throw Error("the field of view is " + std::to_string(camera.fov_x_degrees) + " degrees; it must lie in (0, 180)");
  if (!(camera.near_clip > 0.0f && camera.far_clip > camera.near_clip))
    throw Error("the clipping planes lie at " + std::to_string(camera.near_clip) + " and " +
                std::to_string(camera.far_clip) + "; give 0 < near_clip < far_clip");
  if (camera.aperture_radius > 0.0f && !(camera.focus_distance > 0.0f))
    throw Error("a thin lens needs a focus_distance above 0");
  if (!(film.filter_radius > 0.0f)) throw Error("the reconstruction filter needs a radius above 0");
  for (int i = 0; i < 4; ++i) {
    for (int k = 0; k < 3; ++k) lens_.to_world[i][k] = camera.to_world[i][k];
  }
  lens_.width = float(film.width);
  lens_.height = float(film.height);
  lens_.principal_offset[0] = camera.principal_offset.x;
  lens_.principal_offset[1] = camera.principal_offset.y;
  lens_.tan_x = float(std::tan(0.5 * double(camera.fov_x_degrees) * 3.14159265358979323846 / 180.0));
  lens_.tan_y = lens_.tan_x * lens_.height / lens_.width;
  lens_.near_clip = camera.near_clip;
  lens_.far_clip = camera.far_clip;
  lens_.aperture_radius = camera.aperture_radius;
  lens_.focus_distance = camera.focus_distance;
  lens_.scale = glm::length(camera.to_world[2]);
  lens_.filter = film.filter;
  lens_.filter_radius = film.filter_radius;
  if (film.filter == FilterKind::gaussian) {
    if (!(film.gaussian_stddev > 0.0f)) throw Error("the gaussian filter needs a stddev above 0");
    gaussian_ = tabulate_gaussian(film.filter_radius, film.gaussian_stddev);
    lens_.gaussian = gaussian_.data();
    lens_.gaussian_steps = k_gaussian_steps;
  }
}

float CameraSampler::filter_offset(float u) const { return scalar::filter_offset<float>(lens_, u); }

CameraRay CameraSampler::ray_at(const Vec2& p, const Vec2& u_lens) const {
  const scalar::CameraRayLanes<float> ray = scalar::camera_ray<float>(lens_, p.x, p.y, u_lens.x, u_lens.y);
  return {to_vec(ray.origin), to_vec(ray.direction), ray.tmax, ray.near_distance};
}

void CameraSampler::sample(const CameraSamples& samples, uint32_t picture_seed, Isa isa, RayBatch& rays,
                           AlignedVector<float>& near_distance, SampleSeeds& seeds) const {
  rays.resize(samples.size);
  near_distance.resize(padded(samples.size));
  seeds.pixel.resize(padded(samples.size)), seeds.vertex.resize(padded(samples.size));
  camera_kernel_for(resolve_isa(isa))(lens_, samples, picture_seed, rays, near_distance.data(), seeds.pixel.data(),
                                      seeds.vertex.data());
  rays.resize(samples.size);  // the kernel has written into the padding
}

void sample_camera_scalar(const CameraLens& lens, const CameraSamples& samples, uint32_t picture_seed, RayBatch& rays,
                          float* near_distance, uint32_t* pixel_seeds, uint32_t* vertex_seeds) {
  scalar::sample_camera_batch<float>(lens, samples, picture_seed, rays, near_distance, pixel_seeds, vertex_seeds);
}

}  // namespace fieldtrace
