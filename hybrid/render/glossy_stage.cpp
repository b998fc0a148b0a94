#include "hybrid/render/glossy_stage.h"

#include <algorithm>
#include <limits>
#include <set>

#include "hybrid/path/patch_vertex.h"

namespace fieldtrace {
namespace {

// Settings for paths that begin at the second surface of a camera path.
TransportSettings patch_settings(TransportSettings settings) {
  settings.light_samples = k_patch_samples;
  settings.lobe_samples = 1;
  if (settings.max_depth > 0) settings.max_depth -= 1;
  settings.first_hits = false;
  return settings;
}

// Whether the picture sends glossy rays that can hit lit surfaces.
bool sends_glossy_rays(const Scene& scene, const TransportSettings& settings, const RenderOptions& options) {
  if (options.force_undecided || (settings.max_depth >= 0 && settings.max_depth < 3)) return false;
  return std::any_of(scene.bsdfs.begin(), scene.bsdfs.end(), [](const Bsdf& b) { return is_rough(b.kind); });
}

}  // namespace

std::vector<uint32_t> choose_hit_instances(const Scene& scene, std::span<const ShapeTraits> traits,
                                           const TransportSettings& settings, const RenderOptions& options,
                                           const FieldParameters& parameters, uint64_t camera_samples) {
  // At tolerance 1 cells answer whose error has no known bound.
  if (options.field_hits == FieldHits::never || options.base_tolerance() >= 1.0f) return {};
  if (!sends_glossy_rays(scene, settings, options)) return {};
  const bool by_request = options.field_hits == FieldHits::always;
  std::vector<uint32_t> suited =
      HitAnswerer::suited_instances(scene, traits, parameters, by_request ? 0 : HitAnswerer::k_fewest_triangles);
  std::set<uint32_t> shapes;
  for (const uint32_t i : suited) shapes.insert(scene.instances[i].shape);
  const double rays = double(camera_samples) * options.lobe_samples;
  if (!by_request && double(shapes.size()) * HitAnswerer::estimated_bake_rays(parameters) > rays) return {};
  return suited;
}

GlossyStage::GlossyStage(const GlossyInput& input) {
  if (!sends_glossy_rays(input.scene, input.settings, input.options)) return;
  make_hits(input);
  make_maps(input);
}

GlossyStage::~GlossyStage() = default;

void GlossyStage::make_hits(const GlossyInput& input) {
  std::vector<uint32_t> instances(input.hit_instances.begin(), input.hit_instances.end());
  // Fields that their memory had no room for: the render is about to begin again.
  std::erase_if(instances, [&](uint32_t i) { return !input.fields[input.scene.instances[i].shape]; });
  if (instances.empty()) return;
  const AnswererSettings settings{input.settings.isa, input.options.base_tolerance(), input.options.check};
  hits_ = std::make_unique<HitAnswerer>(input.scene, input.accel, input.traits, input.fields, instances, settings);
}

void GlossyStage::make_maps(const GlossyInput& input) {
  const RenderOptions& options = input.options;
  const uint64_t most_rays = options.at_any_cost() ? std::numeric_limits<uint64_t>::max()
                                                   : input.camera_samples * uint64_t(options.lobe_samples);
  if (most_rays < LobeAnswerer::k_fewest_rays) return;
  const std::vector<uint32_t> suited = LobeAnswerer::suited_instances(input.scene, input.traits);
  if (suited.empty()) return;
  // Demand decides which patches are shaded together, so their light must not depend on that: whole scenes.
  shading_ = std::make_unique<RayContext>(input.scene, input.accel, input.traits, input.camera,
                                          patch_settings(input.settings), input.lights, true);
  const LobeAnswerer::Settings settings{options.base_tolerance(), most_rays, input.most_map_bytes, options.check};
  lobes_ = std::make_unique<LobeAnswerer>(shading_->context(), suited, settings, hits_.get());
  maps_left_out_ = lobes_->left_out_for_memory();
  if (lobes_->empty()) lobes_.reset();
}

}  // namespace fieldtrace
