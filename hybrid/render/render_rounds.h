// A picture to a given error, or in a given time: rounds of camera samples, each where it lowers the error most.
//
// The first round gives every pixel some samples, in two halves; their differences tell where noise is left
// (hybrid/film/sample_allocation.h), and each later round goes there. Determinism: with a target error alone, the
// picture depends on scene, options and seed, as others do; with a time limit, on the machine's speed, too.
#pragma once

#include "hybrid/render/render_tiles.h"

namespace fieldtrace {

// What is known of a picture by rounds before it is begun.
struct RoundsPlan {
  double field_mean_square = 0.0;  // the error of what is not rays, by the measure
};

// Fills `image`, and of `stats` what rounds add to them. Stops early as render_tiles() does.
void render_rounds(Job& job, const RoundsPlan& plan, Image& image, Stats& stats);

}  // namespace fieldtrace
