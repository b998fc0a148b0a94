// Numbers as text.
#pragma once

#include <optional>
#include <string_view>

namespace fieldtrace {

// The number that all of `text` is, a sign + included; nothing if it is none. What double cannot hold is 0 or infinite,
// as its exponent's sign tells, or, without one, whether digits other than 0 stand before the point.
std::optional<double> parse_double(std::string_view text);

}  // namespace fieldtrace
