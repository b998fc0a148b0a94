// The thesis' claims, each beside what was measured here.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "tools/thesis/measure.h"

namespace fieldtrace {

struct ThesisClaim {
  std::string claim, measured;
  bool holds = false;
};

// Claims whose measurements are missing from `report` (after an interruption) are left out.
std::vector<ThesisClaim> thesis_claims(const ThesisReport& report);

}  // namespace fieldtrace
