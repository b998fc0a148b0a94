#include "hybrid/glossy_stage.h"

#include <algorithm>

#include "hybrid/surface_radiance.h"

namespace fieldtrace {
namespace {

// Which patches are shaded together is a matter of demand: their light must not depend on it.
AnswererSettings patch_answerer_settings(Isa isa) {
  AnswererSettings settings{isa, 0.0f};
  settings.whole_scene = true;
  return settings;
}

// Of paths that begin at a path's second surface.
TransportSettings patch_settings(TransportSettings settings) {
  settings.light_samples = SurfaceRadiance::k_samples;
  settings.lobe_samples = 1;
  if (settings.max_depth > 0) settings.max_depth -= 1;
  settings.count_first_hits = settings.count_reflections = settings.occlusion = false;
  return settings;
}

}  // namespace

GlossyStage::GlossyStage(const GlossyInput& input) {
  const int max_depth = input.settings.max_depth;
  const std::vector<Bsdf>& bsdfs = input.scene.bsdfs;
  const bool is_glossy = std::any_of(bsdfs.begin(), bsdfs.end(), [](const Bsdf& b) { return is_rough(b.kind); });
  if (!is_glossy || input.options.force_ask || (max_depth >= 0 && max_depth < 3)) return;
  const uint64_t most_rays = input.camera_samples * uint64_t(input.options.lobe_samples);
  make_hits(input, most_rays);
  make_pictures(input, most_rays);
}

GlossyStage::~GlossyStage() = default;

void GlossyStage::make_hits(const GlossyInput& input, uint64_t most_rays) {
  if (input.options.field_hits == FieldHits::never) return;
  const std::vector<uint32_t> suited = HitAnswerer::suited_instances(input.scene, input.fields);
  if (suited.empty()) return;
  if (input.options.field_hits == FieldHits::automatic) {
    double bake_rays = 0.0;
    for (const Field* field : input.fields) {
      if (field) bake_rays += HitAnswerer::estimated_bake_rays(field->parameters());
    }
    if (bake_rays > double(most_rays)) return;
  }
  hits_ = std::make_unique<HitAnswerer>(input.scene, input.accel, input.traits, input.fields, suited,
                                        input.settings.isa, input.options.tolerance, input.options.check);
}

void GlossyStage::make_pictures(const GlossyInput& input, uint64_t most_rays) {
  const std::vector<uint32_t> suited = LobeAnswerer::suited_instances(input.scene, input.traits);
  if (suited.empty()) return;
  no_fields_.assign(input.scene.shapes.size(), nullptr);
  exact_ = std::make_unique<ShadowAnswerer>(input.scene, input.accel, input.traits, no_fields_,
                                            patch_answerer_settings(input.settings.isa));
  shading_ = std::make_unique<TransportContext>(input.scene, input.accel, input.camera, *exact_,
                                                patch_settings(input.settings), input.lights);
  lobes_ = std::make_unique<LobeAnswerer>(*shading_, suited, input.options.tolerance, most_rays,
                                          input.most_picture_bytes, hits_.get());
  if (lobes_->empty()) lobes_.reset();
}

}  // namespace fieldtrace
