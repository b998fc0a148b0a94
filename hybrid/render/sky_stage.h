// Makes the direction maps by which a picture's sky is answered. Thread-safety: pure but for the bake, which is
// parallel.
#pragma once

#include <memory>
#include <span>

#include "core/trace/accel.h"
#include "hybrid/render/render.h"
#include "hybrid/sky/sky_maps.h"

namespace fieldtrace {

// Null where the scene has no sky, where maps would cost more rays than they can save, or where the tolerance admits no
// estimates. `light_samples`: of the whole film for one light. Returns maps of some shapes only if `callbacks.stop` was
// set meanwhile.
std::unique_ptr<SkyMaps> make_sky_maps(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                                       const RenderOptions& options, uint64_t light_samples,
                                       const RenderCallbacks& callbacks, Stats& stats);

}  // namespace fieldtrace
