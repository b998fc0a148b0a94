// The thesis' scenes by this program's own renderers: hybrid at three tolerances, Monte Carlo at three sample counts.
//
// What a fieldtrace::Scene can express: diffuse surfaces, two-sided, under point lights that fall off with the squared
// distance, direct light only; lights are as bright at the scene's middle as the thesis' lights are everywhere. Errors
// are against Monte Carlo with many samples, so they compare within this table, not with the Phong pictures.
// Thread-safety: as run_thesis().
#pragma once

#include <atomic>
#include <string>
#include <vector>

#include "tools/thesis/measure.h"

namespace fieldtrace {

// False if `stop` ended it. `scratch_folder` must exist: field caches, removed again, so that a second render is warm.
bool measure_hybrid(const std::vector<PhongScene>& scenes, bool quick, const std::string& scratch_folder,
                    const std::atomic<bool>* stop, std::vector<ThesisHybridRow>& rows);

}  // namespace fieldtrace
