// A transport context in which exact rays answer everything.
// Thread-safety: as TransportContext's.
#pragma once

#include "hybrid/path/transport_context.h"

namespace fieldtrace {

class RayContext {
 public:
  // `whole_scene`: of AnswererSettings. All that is referred to must outlive this.
  RayContext(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits, const CameraSampler& camera,
             const TransportSettings& settings, const std::shared_ptr<const LightTable>& lights, bool whole_scene)
      : answerer_(scene, accel, traits, {}, {.isa = settings.isa, .tolerance = 0.0f, .whole_scene = whole_scene}),
        context_(scene, accel, camera, answerer_, settings, lights) {}
  // The context refers to the answerer.
  RayContext(const RayContext&) = delete;
  RayContext& operator=(const RayContext&) = delete;

  const TransportContext& context() const { return context_; }
  TransportContext& context() { return context_; }

 private:
  ShadowAnswerer answerer_;
  TransportContext context_;
};

}  // namespace fieldtrace
