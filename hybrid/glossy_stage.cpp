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

// Some that may meet a surface which is lit.
bool sends_glossy_rays(const Scene& scene, const TransportSettings& settings, const RenderOptions& options) {
  if (options.force_ask || (settings.max_depth >= 0 && settings.max_depth < 3)) return false;
  return std::any_of(scene.bsdfs.begin(), scene.bsdfs.end(), [](const Bsdf& b) { return is_rough(b.kind); });
}

}  // namespace

bool wants_hits(const Scene& scene, std::span<const ShapeTraits> traits, const TransportSettings& settings,
                const RenderOptions& options, const FieldParameters& parameters, uint64_t camera_samples) {
  if (!sends_glossy_rays(scene, settings, options)) return false;
  if (options.field_hits != FieldHits::automatic) return options.field_hits == FieldHits::always;
  size_t fields = 0, triangles = 0;
  for (size_t s = 0; s < traits.size(); ++s) {
    if (!traits[s].wants_field) continue;
    ++fields;
    triangles += scene.shapes[s].triangle_count();
  }
  if (triangles < fields * HitAnswerer::k_fewest_triangles) return false;
  const uint64_t rays = camera_samples * uint64_t(options.lobe_samples);
  return double(fields) * HitAnswerer::estimated_bake_rays(parameters) < double(rays);
}

GlossyStage::GlossyStage(const GlossyInput& input) {
  if (!sends_glossy_rays(input.scene, input.settings, input.options)) return;
  make_hits(input);
  make_pictures(input);
}

GlossyStage::~GlossyStage() = default;

void GlossyStage::make_hits(const GlossyInput& input) {
  const std::vector<uint32_t> suited = HitAnswerer::suited_instances(input.scene, input.hit_fields);
  if (suited.empty()) return;
  hits_ = std::make_unique<HitAnswerer>(input.scene, input.accel, input.traits, input.hit_fields, suited,
                                        input.settings.isa, input.options.tolerance, input.options.check);
}

void GlossyStage::make_pictures(const GlossyInput& input) {
  const std::vector<uint32_t> suited = LobeAnswerer::suited_instances(input.scene, input.traits);
  if (suited.empty()) return;
  const uint64_t most_rays = input.camera_samples * uint64_t(input.options.lobe_samples);
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
