#include "hybrid/render/indirect_stage.h"

#include <algorithm>

#include "hybrid/indirect/indirect_bounces.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/render/transport.h"

namespace fieldtrace {
namespace {

// Rays that shading may cost for each that Monte Carlo would send to the sky: those leave noise behind.
constexpr uint64_t k_indirect_gain = 8;
// What a surfel costs, in rays.
constexpr uint64_t k_surfel_rays = 64;
// --check: light samples of a surfel.
constexpr int k_check_samples = 64;
// With at most so many occluders maps are finer.
constexpr size_t k_few_occluders = 16;

// Settings for paths from surfels.
TransportSettings surfel_settings(TransportSettings settings, int samples) {
  settings.light_samples = settings.lobe_samples = samples;
  settings.pixel_samples = 1;
  if (settings.max_depth > 0) settings.max_depth -= 1;
  settings.first_hits = false;
  return settings;
}

// By instance: whether the light that it sends can be known. Empty: of none.
std::vector<uint8_t> senders(const Scene& scene, const SkyMaps& maps) {
  if (maps.is_crowd()) return {};  // its far groups send no light back
  const auto is_plane = [](const SkyOccluder& o) { return o.kind == SkyOccluder::Kind::plane; };
  if (std::count_if(maps.occluders().begin(), maps.occluders().end(), is_plane) > k_most_planes) return {};
  std::vector<uint8_t> sends;
  for (const SkyOccluder& o : maps.occluders()) {
    const bool has_surfels = o.kind != SkyOccluder::Kind::ball;
    sends.push_back(has_surfels && is_diffuse_and_opaque(scene, scene.instances[o.instance].bsdf));
  }
  if (std::find(sends.begin(), sends.end(), 1) == sends.end()) return {};
  return sends;
}

IndirectSize choose_size(size_t occluders) {
  IndirectSize size;
  if (occluders <= k_few_occluders) return size;
  size.directions = 8, size.texels = 16, size.plane_texels = 32;
  return size;
}

}  // namespace

void make_indirect(const IndirectInput& input, SkyStage& stage, Stats& stats) {
  const int depth = input.settings.max_depth;
  if (!stage.light || (depth >= 0 && depth < 3)) return;
  const std::vector<uint8_t> sends = senders(input.scene, *stage.maps);
  if (sends.empty()) return;
  const IndirectSize size = choose_size(stage.maps->occluders().size());
  const IndirectLight::Cost cost = IndirectLight::cost(*stage.maps, size);
  if (cost.bytes + stage.maps->bytes() > input.request.most_bytes) return;
  if (cost.surfels * k_surfel_rays > input.request.light_rays * k_indirect_gain) return;
  const std::vector<Field*> no_fields(input.scene.shapes.size(), nullptr);
  AnswererSettings by_rays{input.settings.isa, 0.0f};
  by_rays.whole_scene = true;
  const ShadowAnswerer answerer(input.scene, input.accel, input.traits, no_fields, by_rays);
  TransportContext shading(input.scene, input.accel, input.camera, answerer,
                           surfel_settings(input.settings, k_surfel_samples), input.lights);
  if (shading.open_area_can_be_hit) return;  // such lights are also found by paths
  shading.sky = stage.light.get();
  shading.make_follower = make_path_follower;
  const auto light = std::make_shared<IndirectLight>(input.scene, input.accel, *stage.maps, input.traits, sends, size);
  if (input.callbacks.progress) input.callbacks.progress(0.0f, "bake");
  shading.indirect = light.get();
  TransportContext exact(input.scene, input.accel, input.camera, answerer,
                         surfel_settings(input.settings, k_check_samples), input.lights);
  exact.make_follower = make_path_follower;
  shade_indirect(light, *stage.light, shading, depth < 0 ? -1 : depth - 2, input.check ? &exact : nullptr,
                 input.callbacks.stop, stats);
}

}  // namespace fieldtrace
