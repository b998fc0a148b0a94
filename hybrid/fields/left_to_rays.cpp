#include "hybrid/fields/left_to_rays.h"

namespace fieldtrace {

bool leaves_to_rays(const FieldUse& use, double scale, double fewest_answers) {
  return double(use.answered) * scale < fewest_answers;
}

bool leaves_self_to_rays(const FieldUse& use, double scale, double fewest_answers) {
  const double answered = double(use.self_answered), undecided = double(use.self_undecided);
  return undecided > k_most_undecided * (answered + undecided) || answered * scale < fewest_answers;
}

}  // namespace fieldtrace
