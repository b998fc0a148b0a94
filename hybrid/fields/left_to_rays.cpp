#include "hybrid/fields/left_to_rays.h"

namespace fieldtrace {
namespace {

bool mostly_undecided(uint64_t answered, uint64_t undecided) {
  const uint64_t all = answered + undecided;
  return all >= k_fewest_surveyed && double(undecided) > k_most_undecided * double(all);
}

}  // namespace

bool leaves_to_rays(const FieldUse& use, double scale, double fewest_answers) {
  if (mostly_undecided(use.answered - use.self_answered, use.undecided - use.self_undecided)) return true;
  return double(use.answered) * scale < fewest_answers;
}

bool leaves_self_to_rays(const FieldUse& use, double scale, double fewest_answers) {
  return mostly_undecided(use.self_answered, use.self_undecided) || double(use.self_answered) * scale < fewest_answers;
}

}  // namespace fieldtrace
