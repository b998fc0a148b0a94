// Decides whether diffuse light that objects send on is answered by a picture's direction maps, and prepares it.
// Thread-safety: called by one thread; shading is parallel.
#pragma once

#include <memory>
#include <span>

#include "core/camera/camera.h"
#include "core/light/light_sampling.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/render/sky_stage.h"

namespace fieldtrace {

struct IndirectInput {
  const Scene& scene;
  const Accel& accel;
  const CameraSampler& camera;
  std::span<const ShapeTraits> traits;
  const std::shared_ptr<const LightTable>& lights;
  const TransportSettings& settings;
  const RenderCallbacks& callbacks;
  SkyRequest request;
  bool check = false;
};

// What of the diffuse light that objects send on may be known in a picture.
struct IndirectPlan {
  uint64_t rays = 0;           // what shading costs, as SkyRequest::bounce_rays; 0: nothing is known
  std::vector<uint8_t> sends;  // by instance, whether its light is
};

// Of a picture whose paths may have three surfaces or more (`depth`: max_depth) and find no light.
IndirectPlan plan_indirect(const Scene& scene, const LightTable& lights, std::span<const ShapeTraits> traits,
                           int depth);

// Rays of a path that leaves a diffuse first surface, in the mean, which that light would spare: itself, on and on, and
// one to each light from each further surface. `open`: the share of rays that leave the scene.
double rays_a_path(int depth, double open, size_t lights);

// Gives `stage.light`, if there is one, the light that diffuse objects send on, where that is planned and fits into
// memory. Leaves it without, and returns false, if `callbacks.stop` was set meanwhile.
bool make_indirect(const IndirectInput& input, SkyStage& stage, Stats& stats);

}  // namespace fieldtrace
