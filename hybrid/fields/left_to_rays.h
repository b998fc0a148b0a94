// Which objects are left to exact rays, from what a survey of the picture counted (hybrid/render/field_survey.h).
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <vector>

#include "hybrid/stats/stats.h"

namespace fieldtrace {

// An object whose field leaves more than this share of the rays from elsewhere open, among at least so many rays of the
// survey, is left to exact rays: a ray that asks costs a look-up and a ray that grazes the object, which takes longest
// to trace (docs/decisions/012-left-to-rays.md).
inline constexpr double k_most_undecided = 0.75;
inline constexpr uint64_t k_fewest_surveyed = 256;

// Whether an object of which the survey counted `use` is left to exact rays. `scale`: rays of the picture for one of
// the survey. `fewest_answers`: an object whose field would answer fewer rays of the whole picture is left too.
bool leaves_to_rays(const FieldUse& use, double scale, uint64_t fewest_answers);

// Whether only shading points on the object itself are left to exact rays: where their own field leaves more than
// k_most_undecided of them open. What certificates still promise there is wrong more often than elsewhere.
bool leaves_self_to_rays(const FieldUse& use);

struct FieldSurvey {
  std::vector<FieldUse> uses;  // per shape of the scene
  double scale = 1.0;          // camera samples of the picture for one of the survey
  Stats stats;                 // what the survey did
  bool interrupted = false;    // by `stop`; the counts are then of no use
};

}  // namespace fieldtrace
