#include "hybrid/render/sky_survey.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "core/math/frame.h"
#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "core/sampling/warp.hd.h"
#include "core/simd/vec_lanes.h"
#include "core/surface/surface.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/sky/parallelogram.h"

namespace fieldtrace {
namespace {

constexpr int k_share_side = 32;  // camera rays along each side of the film
constexpr int k_part_rows = 8;    // of these, that one task traces
static_assert(k_share_side % k_part_rows == 0);
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

// What a part of the grid's rows sees.
struct Rows {
  std::vector<Vec3> seen;
  size_t diffuse = 0;
  RayBatch from_surfaces;
  HitBatch met_next;  // by these

  void see(const Scene& scene, const Accel& accel, const CameraSampler& camera, const Rect& window, int first_row) {
    const size_t count = size_t(k_part_rows) * k_share_side;
    RayBatch rays;
    HitBatch hits;
    rays.resize(count);
    hits.resize(count);
    const Vec2 corner(float(window.x), float(window.y));
    const Vec2 step(float(window.width) / float(k_share_side), float(window.height) / float(k_share_side));
    for (size_t i = 0; i < count; ++i) {
      const Vec2 place(float(i % k_share_side), float(first_row + int(i / k_share_side)));
      const CameraRay ray = camera.ray_at(corner + (place + 0.5f) * step, Vec2(0.5f));
      rays.set(i, ray.origin, ray.direction, k_infinity);
    }
    accel.intersect(rays, hits, Coherence::coherent);
    size_t sent = 0;
    from_surfaces.resize(count * k_rays_of_surface);
    for (size_t i = 0; i < count; ++i) {
      if (hits.instance[i] == k_none) continue;
      seen.push_back(rays.origin(i) + rays.direction(i) * (k_before * hits.t[i]));
      if (!has_diffuse_body(scene, scene.instances[hits.instance[i]].bsdf)) continue;
      diffuse += 1;
      const SurfacePoint s = surface_at(scene, rays, hits, i);
      const Vec3 normal =
          glm::dot(s.geometric_normal, rays.direction(i)) > 0.0f ? -s.geometric_normal : s.geometric_normal;
      const Frame frame = frame_about(normal);
      const auto number = uint32_t(size_t(first_row) * k_share_side + i);
      for (uint32_t k = 0; k < uint32_t(k_rays_of_surface); ++k) {
        const auto u = scalar::sample_2d(k, scalar::hash_combine(number, 1u), 0);
        const auto local = scalar::cosine_hemisphere_centred<float>(2.0f * u.x - 1.0f, 2.0f * u.y - 1.0f);
        const Vec3 d = frame.to_world(Vec3(local.x, local.y, local.z));
        from_surfaces.set(sent++, offset_origin(s.position, normal, s.error, d), d, k_infinity);
      }
    }
    from_surfaces.resize(sent);
    met_next.resize(sent);
    accel.intersect(from_surfaces, met_next, Coherence::incoherent);
  }
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
  std::vector<Rows> parts(k_share_side / k_part_rows);
  parallel_for(parts.size(), [&](size_t i) { parts[i].see(scene, accel, camera, window, int(i) * k_part_rows); });
  SkySurvey survey;
  size_t diffuse = 0, sent = 0;
  for (const Rows& rows : parts) {
    survey.seen.insert(survey.seen.end(), rows.seen.begin(), rows.seen.end());
    diffuse += rows.diffuse;
    sent += rows.from_surfaces.size;
  }
  const auto rays = double(k_share_side * k_share_side);
  survey.met = double(std::max(survey.seen.size(), size_t(1))) / rays;
  survey.diffuse = survey.seen.empty() ? survey.met : double(diffuse) / rays;
  if (sent == 0) return survey;
  const Planes planes(scene, traits);
  size_t open = 0, by_meshes = 0;
  survey.met_next.resize(scene.instances.size());
  for (const Rows& rows : parts) {
    for (size_t i = 0; i < rows.from_surfaces.size; ++i) {
      const uint32_t instance = rows.met_next.instance[i];
      open += instance == k_none;
      if (instance == k_none) continue;
      survey.met_next[instance] += 1.0 / double(sent);
      by_meshes += !planes.has(instance);
    }
  }
  survey.open = double(open) / double(sent);
  survey.hidden_by_maps = double(by_meshes) / double(sent);
  if (survey.is_enclosed()) {  // else what stands behind does not matter
    size_t behind = 0;
    for (const Rows& rows : parts) {
      const RayBatch& next = rows.from_surfaces;
      for (size_t i = 0; i < next.size; ++i) {
        const uint32_t instance = rows.met_next.instance[i];
        if (instance == k_none || planes.has(instance)) continue;
        behind += planes.hide(next.origin(i), next.direction(i));
      }
    }
    survey.hidden_by_maps -= double(behind) / double(sent);
  }
  return survey;
}

}  // namespace fieldtrace
