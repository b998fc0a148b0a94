// Standard output, checked like any other output: a failed write is an error. And messages on standard error, which are
// lost where they cannot be written: no picture fails for them.
//
// Thread-safety: main thread only, but for print_message().
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace fieldtrace {

// Call before anything is opened or printed. Standard streams closed by the caller are replaced with descriptors that
// can be neither read nor written; otherwise the next opened file would get their number and receive printed text.
// Writes beyond the file size limit, and to pipes that nobody reads any more, become errors instead of signals that
// would end the program and leave its temporary files behind.
void prepare_streams();

// Flushes what was printed so far. Returns the reason of this or an earlier failure; empty on success.
std::string flush_standard_output();

// The error message for a reason.
std::string standard_output_message(const std::string& reason);

// Prints to standard error.
template <class... Args>
void print_message(fmt::format_string<Args...> format, Args&&... args) {
  const std::string text = fmt::format(format, std::forward<Args>(args)...);
  std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace fieldtrace
