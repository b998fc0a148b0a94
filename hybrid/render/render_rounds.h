// Pictures whose sums are kept: to a given error, in a given time, or with checkpoints.
//
// By rounds: the first round gives every pixel some samples, in two halves; their differences tell where noise is left
// (hybrid/film/sample_allocation.h), and each later round goes there. Otherwise one pass takes all samples, and if the
// picture is resumed with more of them, another one what is missing. Determinism: with a target error alone, the
// picture depends on scene, options and seed, as others do, and not on interrupts; with a time limit, on the machine's
// speed, too.
#pragma once

#include "hybrid/film/checkpoint.h"
#include "hybrid/render/render_tiles.h"

namespace fieldtrace {

// Renders until the picture is finished or `job` stops, from `state` on: a new one holds decisions, no counts and no
// film. Fills `image`, and of `stats` what passes add to them. Writes checkpoints where the options name a file.
void render_rounds(Job& job, Checkpoint state, Image& image, Stats& stats);

}  // namespace fieldtrace
