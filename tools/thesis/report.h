// The thesis' tables as CSV and as one self-contained HTML page.
//
// Thread-safety: pure functions.
#pragma once

#include <string>

#include "tools/thesis/measure.h"

namespace fieldtrace {

// One line per case and M. Empty entries: the thesis gives no figure, or the case is not polished.
std::string thesis_csv(const ThesisReport& report);
std::string thesis_growth_csv(const ThesisReport& report);
std::string thesis_charts_csv(const ThesisReport& report);
std::string thesis_hybrid_csv(const ThesisReport& report);

// Images as data: URIs, plots as inline SVG. `command`: as typed.
std::string thesis_page(const ThesisReport& report, const std::string& command, const std::string& version);

}  // namespace fieldtrace
