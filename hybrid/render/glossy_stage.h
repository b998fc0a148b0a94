// Chooses what answers the glossy rays of one picture: prefiltered radiance maps, certified hits, or exact rays only.
//
// Thread-safety: made by one thread; its answerers may be used by any number.
#pragma once

#include <memory>
#include <vector>

#include "core/camera/camera.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/path/ray_context.h"
#include "hybrid/render/render.h"
#include "hybrid/transport/transport.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {

// The instances for which certified hits answer glossy rays. With FieldHits::always all suited ones; otherwise those
// with large meshes, if the picture may send more glossy rays than baking their fields takes. camera_samples: of the
// whole film.
std::vector<uint32_t> choose_hit_instances(const Scene& scene, std::span<const ShapeTraits> traits,
                                           const TransportSettings& settings, const RenderOptions& options,
                                           const FieldParameters& parameters, uint64_t camera_samples);

// Everything referred to must outlive the stage.
struct GlossyInput {
  const Scene& scene;
  const Accel& accel;
  const CameraSampler& camera;
  const std::vector<ShapeTraits>& traits;
  const std::shared_ptr<const LightTable>& lights;
  const TransportSettings& settings;
  const RenderOptions& options;
  const std::vector<Field*>& fields;  // by shape; at least those of hit_instances
  std::span<const uint32_t> hit_instances;
  uint64_t camera_samples = 0;  // of the whole film
  uint64_t most_map_bytes = 0;
};

class GlossyStage {
 public:
  explicit GlossyStage(const GlossyInput& input);
  ~GlossyStage();

  const LobeAnswerer* lobes() const { return lobes_.get(); }  // null: no maps
  const HitAnswerer* hits() const { return hits_.get(); }     // null: no certified hits
  // Objects that would have maps if they might take more than most_map_bytes.
  size_t maps_left_out() const { return maps_left_out_; }

 private:
  void make_hits(const GlossyInput& input);
  void make_maps(const GlossyInput& input);

  std::unique_ptr<HitAnswerer> hits_;
  // Patches are shaded by exact rays: their shading points lie all over an object, and would bake its field for few
  // rays each.
  std::unique_ptr<RayContext> shading_;
  std::unique_ptr<LobeAnswerer> lobes_;
  size_t maps_left_out_ = 0;
};

}  // namespace fieldtrace
