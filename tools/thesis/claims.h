// What the thesis claims, each with what was measured here.
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

// Claims whose measurements `report` lacks (it was interrupted) are left out.
std::vector<ThesisClaim> thesis_claims(const ThesisReport& report);

}  // namespace fieldtrace
