#include "hybrid/fields/left_to_rays.h"

namespace fieldtrace {
namespace {

bool mostly_asks(uint64_t answered, uint64_t asked) {
  const uint64_t all = answered + asked;
  return all >= k_fewest_surveyed && double(asked) > k_most_asked * double(all);
}

}  // namespace

bool leaves_to_rays(const FieldUse& use, double scale, uint64_t fewest_answers) {
  if (mostly_asks(use.answered - use.own_answered, use.asked - use.own_asked)) return true;
  return double(use.answered) * scale < double(fewest_answers);
}

bool leaves_own_to_rays(const FieldUse& use) { return mostly_asks(use.own_answered, use.own_asked); }

}  // namespace fieldtrace
