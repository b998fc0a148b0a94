#include "core/camera.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/warp.hd.h"

namespace fieldtrace {
namespace {

// Linear interpolation between so many points of the inverse distribution moves a sample by less than 1e-3 pixels
// everywhere but in the outermost step, whose probability is 1 / 2048.
constexpr int k_gaussian_steps = 2048;

// Mitsuba's gaussian falls to zero at the radius: exp(-x^2 / 2 s^2) - exp(-r^2 / 2 s^2). Its integral from 0 to x:
double gaussian_integral(double x, double radius, double stddev) {
  const double base = std::exp(-radius * radius / (2.0 * stddev * stddev));
  return stddev * std::sqrt(0.5 * 3.14159265358979323846) * std::erf(x / (stddev * std::sqrt(2.0))) - base * x;
}

// Tabulates the inverse of the distribution of |x| by bisection.
std::vector<float> tabulate_gaussian(double radius, double stddev) {
  std::vector<float> table(k_gaussian_steps + 1);
  const double total = gaussian_integral(radius, radius, stddev);
  double low = 0.0;
  for (int k = 0; k <= k_gaussian_steps; ++k) {
    const double target = total * k / k_gaussian_steps;
    double high = radius;
    double a = low;
    // 40 halvings of the radius reach 1e-12 of it.
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

CameraSampler::CameraSampler(const Camera& camera, const Film& film) : camera_(camera), film_(film) {
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
  tan_x_ = float(std::tan(0.5 * double(camera.fov_x_degrees) * 3.14159265358979323846 / 180.0));
  tan_y_ = tan_x_ * float(film.height) / float(film.width);
  scale_ = glm::length(camera.to_world[2]);
  if (film.filter == FilterKind::gaussian) {
    if (!(film.gaussian_stddev > 0.0f)) throw Error("the gaussian filter needs a stddev above 0");
    gaussian_ = tabulate_gaussian(film.filter_radius, film.gaussian_stddev);
  }
}

float CameraSampler::filter_offset(float u) const {
  const float centred = 2.0f * u - 1.0f;  // exact: u is a multiple of 2^-24
  const float r = film_.filter_radius;
  switch (film_.filter) {
    case FilterKind::box:
      return r * centred;
    case FilterKind::tent:
      return std::copysign(r * (1.0f - std::sqrt(1.0f - std::abs(centred))), centred);
    case FilterKind::gaussian:
      break;
  }
  const float position = std::abs(centred) * float(k_gaussian_steps);
  const int k = std::min(int(position), k_gaussian_steps - 1);
  const float f = position - float(k);
  return std::copysign((1.0f - f) * gaussian_[k] + f * gaussian_[k + 1], centred);
}

CameraRay CameraSampler::ray(int x, int y, const Vec2& u_film, const Vec2& u_lens) const {
  return ray_at({float(x) + 0.5f + filter_offset(u_film.x), float(y) + 0.5f + filter_offset(u_film.y)}, u_lens);
}

CameraRay CameraSampler::ray_at(const Vec2& p, const Vec2& u_lens) const {
  const float fx = p.x / float(film_.width) + camera_.principal_offset.x;
  const float fy = p.y / float(film_.height) + camera_.principal_offset.y;
  const Vec3 through((1.0f - 2.0f * fx) * tan_x_, (1.0f - 2.0f * fy) * tan_y_, 1.0f);
  Vec3 lens(0.0f);
  Vec3 d = through;
  if (camera_.aperture_radius > 0.0f) {
    const scalar::DiskPoint<float> disk = scalar::concentric_disk(u_lens.x, u_lens.y);
    lens = Vec3(disk.cosine, disk.sine, 0.0f) * (disk.radius * camera_.aperture_radius);
    d = through * camera_.focus_distance - lens;
  }
  d = glm::normalize(d);
  const float near_t = camera_.near_clip / d.z;
  CameraRay ray;
  ray.origin = transform_point(camera_.to_world, lens + d * near_t);
  ray.direction = glm::normalize(transform_vector(camera_.to_world, d));
  ray.near_distance = near_t * scale_;
  ray.tmax = (camera_.far_clip / d.z - near_t) * scale_;
  return ray;
}

}  // namespace fieldtrace
