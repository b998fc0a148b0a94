#include "core/io/number_text.h"

#include <charconv>
#include <limits>

namespace fieldtrace {
namespace {

// A number that double cannot hold.
double beyond_double(std::string_view text) {
  const bool is_negative = text.starts_with('-');
  const size_t exponent = text.find_first_of("eE");
  const bool is_small = exponent != std::string_view::npos
                            ? text.substr(exponent + 1, 1) == "-"
                            : text.substr(0, text.find('.')).find_first_of("123456789") == std::string_view::npos;
  const double magnitude = is_small ? 0.0 : std::numeric_limits<double>::infinity();
  return is_negative ? -magnitude : magnitude;
}

}  // namespace

std::optional<double> parse_double(std::string_view text) {
  if (text.starts_with('+')) {
    text.remove_prefix(1);
    if (text.starts_with('-')) return std::nullopt;
  }
  double value = 0.0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (stop != end || text.empty()) return std::nullopt;
  if (error == std::errc::result_out_of_range) return beyond_double(text);
  return error == std::errc() ? std::optional(value) : std::nullopt;
}

}  // namespace fieldtrace
