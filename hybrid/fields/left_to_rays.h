// Which objects are left to exact rays, from the counts of a survey of the picture (hybrid/render/field_survey.h).
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <vector>

#include "hybrid/stats/stats.h"

namespace fieldtrace {

// Shading points on an object are left to exact rays if its field leaves more than this share of their rays undecided:
// what it answers of the rest is wrong more often than elsewhere (docs/decisions/012-left-to-rays.md).
inline constexpr double k_most_undecided = 0.75;

// Exact rays that take the time of one look-up (docs/decisions/012-left-to-rays.md).
inline constexpr double k_look_up_cost = 0.5;

// Whether an object with the survey counts `use` is left to exact rays: its field would answer fewer than
// `fewest_answers` rays of the whole picture. `scale`: rays of the picture for each surveyed ray.
bool leaves_to_rays(const FieldUse& use, double scale, double fewest_answers);

// Whether shading points on the object itself are: where more than k_most_undecided of their surveyed rays are
// undecided, or fewer than `fewest_answers` of the whole picture's would be answered.
bool leaves_self_to_rays(const FieldUse& use, double scale, double fewest_answers);

// Shadow rays of a camera sample for each of its light samples.
struct ShadowRays {
  double open = 0.0;    // from its first surface to lights that may have more samples there
  double others = 0.0;  // all others
};

struct FieldSurvey {
  std::vector<FieldUse> uses;  // per shape of the scene
  double scale = 1.0;          // camera samples of the picture for each surveyed one
  Stats stats;                 // of the survey's own rays
  ShadowRays rays = {};
  double look_ups = 0.0;     // of the whole picture
  bool interrupted = false;  // by `stop`; the counts are then meaningless
};

}  // namespace fieldtrace
