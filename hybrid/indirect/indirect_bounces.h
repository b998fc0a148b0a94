// Shades the surfels of a scene by what its lights, its sky and other surfels send to them, bounce by bounce.
// Thread-safety: called by one thread; shading is parallel, and comes out the same whatever the threads.
#pragma once

#include <atomic>
#include <memory>

#include "hybrid/path/transport_context.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {

// Fills `light` with what arrives after at most `bounces` reflections (negative: as many as change anything), and gives
// it to `sky`. Surfels are the first surfaces of paths of `shading`: its sky is `sky`, its indirect is `light`, and its
// light_samples and lobe_samples are k_patch_samples; its max_depth is set for each bounce where these have a limit.
// Instances that send light are diffuse and opaque (unchecked). If `stop` (may be null) was set meanwhile `sky` has
// none. Rays and time are counted as baking. With `exact` (its max_depth is that of paths from surfels, and it has no
// sky maps), some surfels are compared with paths from them.
void shade_indirect(const std::shared_ptr<IndirectLight>& light, Sky& sky, TransportContext& shading, int bounces,
                    const TransportContext* exact, const std::atomic<bool>* stop, Stats& stats);

}  // namespace fieldtrace
