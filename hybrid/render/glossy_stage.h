// What answers the glossy rays of one picture: prefiltered radiance maps, certified hits, or neither.
//
// Thread-safety: made by one thread; its answerers may be asked from any number.
#pragma once

#include <memory>
#include <vector>

#include "core/camera/camera.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/render/render.h"
#include "hybrid/render/transport.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {

// The instances that certified hits are to answer glossy rays about. By request: all that suit; else those with large
// meshes, if the picture may send more glossy rays than the bake of their fields would take. camera_samples: of the
// film.
std::vector<uint32_t> choose_hit_instances(const Scene& scene, std::span<const ShapeTraits> traits,
                                           const TransportSettings& settings, const RenderOptions& options,
                                           const FieldParameters& parameters, uint64_t camera_samples);

// All must outlive the stage.
struct GlossyInput {
  const Scene& scene;
  const Accel& accel;
  const CameraSampler& camera;
  const std::vector<ShapeTraits>& traits;
  const std::shared_ptr<const LightTable>& lights;
  const TransportSettings& settings;
  const RenderOptions& options;
  const std::vector<Field*>& fields;  // by shape, those of hit_instances at least
  std::span<const uint32_t> hit_instances;
  uint64_t camera_samples = 0;  // of the film
  uint64_t most_map_bytes = 0;
};

class GlossyStage {
 public:
  explicit GlossyStage(const GlossyInput& input);
  ~GlossyStage();

  const LobeAnswerer* lobes() const { return lobes_.get(); }  // null: no maps
  const HitAnswerer* hits() const { return hits_.get(); }     // null: no certified hits

 private:
  void make_hits(const GlossyInput& input);
  void make_maps(const GlossyInput& input);

  std::unique_ptr<HitAnswerer> hits_;
  // Radiance is shaded by exact rays: shading points all over an object would have its field baked for few rays each.
  std::vector<Field*> no_fields_;
  std::unique_ptr<ShadowAnswerer> exact_;
  std::unique_ptr<TransportContext> shading_;
  std::unique_ptr<LobeAnswerer> lobes_;
};

}  // namespace fieldtrace
