// What is decided about a picture by rounds before it is begun, by surveys of a few of its pixels.
//
// Surveys count as such in the statistics, and what they bake as bakes. Determinism: as pictures. Thread-safety: called
// by one thread; tracing is parallel.
#pragma once

#include "hybrid/film/checkpoint.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/render/picture.h"
#include "hybrid/stats/stats.h"

namespace fieldtrace {

// Sets how many samples a pixel is expected to need with rays alone. Where these are few, fields are not trusted.
void expect_samples(Picture& picture, Stage& stage, Stats& stats);

// Sets the light and lobe samples of each camera sample that lower noise most for their work, and what `decided` says
// of camera samples; where fields answer, lobe samples alone.
void choose_samples(const Picture& picture, Stage& stage, bool rays_alone, TransportContext& context,
                    Checkpoint& decided, Stats& stats);

// Whether fields will reach the target error, and sooner than rays, or err less at the end of the time; if not, says in
// `stage` what accuracy to try next. Sets what `decided` says of errors and samples.
bool trusts_fields(const Picture& picture, Stage& stage, const TransportContext& context, Checkpoint& decided,
                   Stats& stats);

}  // namespace fieldtrace
