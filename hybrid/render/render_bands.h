// The tiles of a picture in bands of many, for a device: a band's batches go from surface to surface together, so that
// the questions about their light are waves of k_wave_samples light samples and more (hybrid/visibility).
//
// Two bands are under way at once: while the device answers for one, the CPU works on the other. A band holds fewer
// light samples only at the end of the picture. What it takes of memory: docs/gpu.md.
#pragma once

#include "hybrid/render/render_tiles.h"

namespace fieldtrace {

// As trace_tiles(), for a context whose answerer has a device.
void trace_bands(Job& job, const Pass& pass, const std::function<void(size_t tile, const TileSums&)>& finished,
                 const std::function<void(size_t tiles)>& progress, Stats& stats);

}  // namespace fieldtrace
