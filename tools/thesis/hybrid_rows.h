// The thesis' scenes in this program's renderers: hybrid at three tolerances, Monte Carlo at three sample counts.
//
// Limited to what a fieldtrace::Scene can express: two-sided diffuse surfaces (mirrors too, with their diffuse colour)
// under point lights with inverse-square falloff, direct light only. The lights are as bright at the scene's middle as
// the thesis' lights are everywhere. Errors are against Monte Carlo with many samples, so they compare within this
// table, not with the Phong images.
// Thread-safety: as run_thesis().
#pragma once

#include <atomic>
#include <string>
#include <vector>

#include "tools/thesis/measure.h"

namespace fieldtrace {

// Returns false if `stop` ended it. `scratch_folder` must exist; it takes the field caches that make second renders
// warm, which are removed again.
bool measure_hybrid(const std::vector<PhongScene>& scenes, bool quick, const std::string& scratch_folder,
                    const std::atomic<bool>* stop, std::vector<ThesisHybridRow>& rows);

}  // namespace fieldtrace
