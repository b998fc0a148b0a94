#include "hybrid/render/sky_survey.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "core/math/frame.h"
#include "core/sampling/sobol.hd.h"
#include "core/sampling/warp.hd.h"
#include "core/simd/vec_lanes.h"
#include "core/surface/surface.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/sky/parallelogram.h"

namespace fieldtrace {
namespace {

constexpr int k_share_side = 32;      // camera rays along each side of the film
constexpr float k_before = 0.99f;     // of the way to a surface: on this side of it
constexpr int k_rays_of_surface = 4;  // from each surface that they meet
// Of the sky, or of what is beyond the scene: where less comes in, what maps let through shows.
constexpr double k_least_sky = 0.03;
// Of what is hidden. Maps let up to .04 of it through.
constexpr double k_least_open = 0.4;

// The parallelograms and boxes of a scene, which nothing passes between.
class Planes {
 public:
  Planes(const Scene& scene, std::span<const ShapeTraits> traits) {
    const PlaneShapes shapes = plane_shapes(scene, traits);
    for (const Instance& i : scene.instances) {
      is_plane_.push_back(shapes.has(i.shape));
      if (const auto& plane = shapes.parallelograms[i.shape]) add(*plane, i.to_world);
      if (const auto& faces = shapes.boxes[i.shape]) {
        for (const Parallelogram& face : *faces) add(face, i.to_world);
      }
    }
  }
  bool has(uint32_t instance) const { return is_plane_[instance]; }
  bool hide(const Vec3& origin, const Vec3& direction) const {
    for (const Plane& plane : planes_) {
      const DVec3 o = plane.to_unit * (DVec3(origin) - plane.centre), d = plane.to_unit * DVec3(direction);
      const DVec3 at = o - (o.z / d.z) * d;
      if (o.z * d.z < 0.0 && std::abs(at.x) <= 1.0 && std::abs(at.y) <= 1.0) return true;
    }
    return false;
  }

 private:
  struct Plane {
    DVec3 centre;
    DMat3 to_unit;  // the inverse of Parallelogram::axes
  };

  void add(const Parallelogram& of_shape, const Affine& to_world) {
    const Parallelogram here = in_world(of_shape, to_world);
    if (std::abs(glm::determinant(here.axes)) > 0.0) {
      planes_.push_back({here.centre, glm::inverse(here.axes)});
    }
  }

  std::vector<uint8_t> is_plane_;  // by instance
  std::vector<Plane> planes_;
};

}  // namespace

bool SkySurvey::is_enclosed() const { return open < std::max(k_least_sky, k_least_open * hidden_by_maps); }

double SkySurvey::share_of_met_next(std::span<const uint8_t> these) const {
  double all = 0.0, share = 0.0;
  for (size_t i = 0; i < met_next.size(); ++i) {
    all += met_next[i];
    share += these[i] ? met_next[i] : 0.0;
  }
  return all > 0.0 ? share / all : 1.0;
}

SkySurvey survey_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                     const CameraSampler& camera, const Rect& window) {
  RayBatch rays;
  HitBatch hits;
  rays.resize(size_t(k_share_side * k_share_side));
  hits.resize(rays.size);
  const Vec2 corner(float(window.x), float(window.y));
  const Vec2 step(float(window.width) / float(k_share_side), float(window.height) / float(k_share_side));
  for (int i = 0; i < k_share_side * k_share_side; ++i) {
    const Vec2 p = corner + (Vec2(float(i % k_share_side), float(i / k_share_side)) + 0.5f) * step;
    const CameraRay ray = camera.ray_at(p, Vec2(0.5f));
    rays.set(size_t(i), ray.origin, ray.direction, k_infinity);
  }
  accel.intersect(rays, hits, Coherence::coherent);
  SkySurvey survey;
  size_t diffuse = 0, sent = 0;
  RayBatch from_surfaces;
  from_surfaces.resize(rays.size * k_rays_of_surface);
  for (size_t i = 0; i < rays.size; ++i) {
    if (hits.instance[i] == k_none) continue;
    survey.seen.push_back(rays.origin(i) + rays.direction(i) * (k_before * hits.t[i]));
    if (!has_diffuse_body(scene, scene.instances[hits.instance[i]].bsdf)) continue;
    diffuse += 1;
    const SurfacePoint s = surface_at(scene, rays, hits, i);
    const Vec3 normal =
        glm::dot(s.geometric_normal, rays.direction(i)) > 0.0f ? -s.geometric_normal : s.geometric_normal;
    const Frame frame = frame_about(normal);
    for (uint32_t k = 0; k < uint32_t(k_rays_of_surface); ++k) {
      const auto u = scalar::sample_2d(k, scalar::hash_combine(uint32_t(i), 1u), 0);
      const auto local = scalar::cosine_hemisphere_centred<float>(2.0f * u.x - 1.0f, 2.0f * u.y - 1.0f);
      const Vec3 d = frame.to_world(Vec3(local.x, local.y, local.z));
      from_surfaces.set(sent++, offset_origin(s.position, normal, s.error, d), d, k_infinity);
    }
  }
  survey.met = double(std::max(survey.seen.size(), size_t(1))) / double(rays.size);
  survey.diffuse = survey.seen.empty() ? survey.met : double(diffuse) / double(rays.size);
  if (sent == 0) return survey;
  from_surfaces.size = sent;
  hits.resize(sent);
  accel.intersect(from_surfaces, hits, Coherence::incoherent);
  const Planes planes(scene, traits);
  size_t open = 0;
  survey.met_next.resize(scene.instances.size());
  std::vector<size_t> by_meshes;
  for (size_t i = 0; i < sent; ++i) {
    open += hits.instance[i] == k_none;
    if (hits.instance[i] == k_none) continue;
    survey.met_next[hits.instance[i]] += 1.0 / double(sent);
    if (!planes.has(hits.instance[i])) by_meshes.push_back(i);
  }
  survey.open = double(open) / double(sent);
  survey.hidden_by_maps = double(by_meshes.size()) / double(sent);
  if (survey.is_enclosed()) {  // else what stands behind does not matter
    const auto behind = std::count_if(by_meshes.begin(), by_meshes.end(), [&](size_t i) {
      return planes.hide(from_surfaces.origin(i), from_surfaces.direction(i));
    });
    survey.hidden_by_maps -= double(behind) / double(sent);
  }
  return survey;
}

}  // namespace fieldtrace
