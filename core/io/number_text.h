// Numbers as text.
#pragma once

#include <optional>
#include <string_view>

namespace fieldtrace {

// The number that all of `text` is, a sign + included; nothing if it is none. What double cannot hold is 0 if it is too
// small, and infinite if it is too large.
std::optional<double> parse_double(std::string_view text);

}  // namespace fieldtrace
