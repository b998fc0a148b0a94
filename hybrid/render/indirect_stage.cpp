#include "hybrid/render/indirect_stage.h"

#include <algorithm>

#include "field/store/field.h"
#include "hybrid/culling/light_extent.h"
#include "hybrid/indirect/indirect_bounces.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/path/ray_context.h"
#include "hybrid/transport/transport.h"

namespace fieldtrace {
namespace {

// What shading a surfel once costs with k_coarse_directions, in rays.
constexpr uint64_t k_rays_a_surfel = 24;
// Bounces that are shaded of long paths, roughly.
constexpr int k_usual_bounces = 6;
// --check: light samples of a surfel.
constexpr int k_check_samples = 64;

// How many times as large an object is of which others may lie before and behind parts.
constexpr float k_much_larger = 4.0f;

int bounces_of(int depth) { return depth < 0 ? k_usual_bounces : std::min(depth - 2, k_usual_bounces); }

// Settings for paths from surfels.
TransportSettings surfel_settings(TransportSettings settings, int samples) {
  settings.light_samples = settings.lobe_samples = samples;
  settings.pixel_samples = 1;
  if (settings.max_depth > 0) settings.max_depth -= 1;
  settings.first_hits = false;
  return settings;
}

// Of parallelograms, beside sky maps of so many directions.
int plane_texels_beside(int directions) { return std::min(k_most_plane_texels, 2 * directions); }

// By instance, whether its light may be known; empty: of none. Maps know objects from without, and which of two comes
// first by their centres. So the light of two objects is not where the centre of one lies in the box of the other, in
// its own space; nor any where the camera does, or where a much smaller object's centre lies there, as in a room, or in
// the ball about the box, as on a ground: how far a room's walls are its centre does not tell.
std::vector<uint8_t> instances_apart(const Scene& scene, std::span<const ShapeTraits> traits,
                                     const PlaneShapes& planes) {
  std::vector<uint8_t> apart(scene.instances.size(), 1);
  std::vector<Sphere> balls;  // about their boxes
  for (const Instance& i : scene.instances) {
    balls.push_back(field_ball(world_bounds(scene.shapes[i.shape].bounds, i.to_world)));
  }
  for (size_t k = 0; k < balls.size(); ++k) {
    const Instance& instance = scene.instances[k];
    const ShapeTraits& of = traits[instance.shape];
    if (planes.has(instance.shape)) continue;
    const auto is_within = [&](const Vec3& p) { return !of.is_flat && lies_in_box(scene, instance, p); };
    if (is_within(scene.camera.to_world[3])) return {};
    for (size_t other = 0; other < balls.size(); ++other) {
      if (other == k) continue;
      const Vec3& centre = balls[other].centre;
      const bool is_small = balls[other].radius * k_much_larger < balls[k].radius;
      if (is_small && (is_within(centre) || glm::distance(centre, balls[k].centre) < balls[k].radius)) return {};
      if (is_within(centre)) apart[k] = apart[other] = 0;
    }
  }
  return apart;
}

}  // namespace

IndirectPlan plan_indirect(const Scene& scene, const LightTable& lights, std::span<const ShapeTraits> traits,
                           int depth) {
  if ((depth >= 0 && depth < 3) || scene.emitters.empty() || has_open_area(scene, lights)) return {};
  const size_t count = scene.instances.size();
  if (count > k_crowd) return {};  // its far groups send no light back
  const PlaneShapes shapes = plane_shapes(scene, traits);
  IndirectPlan plan;
  plan.sends = instances_apart(scene, traits, shapes);
  if (plan.sends.empty()) return {};
  size_t planes = 0, senders = 0;
  for (size_t k = 0; k < count; ++k) {
    const Instance& i = scene.instances[k];
    planes += shapes.parallelograms[i.shape].has_value();
    plan.sends[k] = plan.sends[k] && is_diffuse_and_opaque(scene, i.bsdf);
    senders += plan.sends[k];
  }
  // Paths to all else go on: without a sky the maps would be made for the rest alone.
  if (planes > size_t(k_most_planes) || senders == 0 || (!has_sky(scene) && senders < count)) return {};
  const uint64_t surfels =
      IndirectLight::cost(planes, count - planes, plane_texels_beside(k_coarse_directions)).surfels;
  plan.rays = surfels * uint64_t(bounces_of(depth) + 3) / 4 * k_rays_a_surfel;  // after the first, one of four
  return plan;
}

double rays_a_path(int depth, double open, size_t lights) {
  const double meets = 1.0 - open;
  double rays = 0.0, goes_on = 1.0;
  for (int k = 0; k < bounces_of(depth); ++k, goes_on *= meets) rays += goes_on * (1.0 + meets * double(lights));
  return rays;
}

bool make_indirect(const IndirectInput& input, SkyStage& stage, Stats& stats) {
  const int depth = input.settings.max_depth;
  const SkyRequest& request = input.request;
  if (!stage.light || !request.bounces) return true;
  std::vector<uint8_t> sends;
  size_t planes = 0;
  for (const SkyOccluder& o : stage.maps->occluders()) {
    planes += o.kind == SkyOccluder::Kind::plane;
    sends.push_back(o.kind != SkyOccluder::Kind::ball && request.sends[o.instance]);
  }
  const int plane_texels = plane_texels_beside(stage.maps->directions());
  const uint64_t bytes = IndirectLight::cost(planes, sends.size() - planes, plane_texels).bytes;
  if (bytes + stage.maps->bytes() > input.request.most_bytes) return true;
  const auto by_rays = [&](int samples) {
    return std::make_unique<RayContext>(input.scene, input.accel, input.traits, input.camera,
                                        surfel_settings(input.settings, samples), input.lights, true);
  };
  const auto shading = by_rays(k_patch_samples);
  shading->context().sky = stage.light.get();
  const auto light = std::make_shared<IndirectLight>(input.scene, input.accel, *stage.maps, input.traits, sends,
                                                     request.seen, plane_texels);
  if (input.callbacks.progress) input.callbacks.progress(0.0f, "bake");
  shading->context().indirect = light.get();
  const auto exact = input.check ? by_rays(k_check_samples) : nullptr;
  shade_indirect(light, *stage.light, shading->context(), depth < 0 ? -1 : depth - 2,
                 exact ? &exact->context() : nullptr, input.callbacks.stop, stats);
  return stage.light->indirect() != nullptr;
}

}  // namespace fieldtrace
