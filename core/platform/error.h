// User-actionable errors with their source location, and the sink for warnings.
//
// Thread-safety: `Error` is a value. A `WarningSink` may be called from one thread at a time, unless it
// says otherwise.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

namespace fieldtrace {

// A place in an input file. Line 0: no line is known (a binary file, say).
struct SourceLocation {
  std::string file;
  int line = 0;
};

// Bad input. what() reads "FILE:LINE: what is wrong and what to do", without the location where it is unknown. The
// command line prints it after "fieldtrace: " and exits with 1.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
  Error(const SourceLocation& where, const std::string& message)
      : std::runtime_error(format_location(where) + message) {}

  static std::string format_location(const SourceLocation& where) {
    if (where.file.empty()) return {};
    return where.file + (where.line > 0 ? ":" + std::to_string(where.line) : std::string()) + ": ";
  }
};

// Wrong use of the command line or the library (contradictory options, say). Exit code 2.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Receives warnings as complete lines without a newline ("FILE:LINE: unknown element <foo>, ignored").
using WarningSink = std::function<void(const std::string&)>;

inline void warn(const WarningSink& sink, const SourceLocation& where, const std::string& message) {
  if (sink) sink(Error::format_location(where) + message);
}

// Forwards each distinct warning once, one at a time from any thread. Copies of the result share their memory of past
// warnings.
inline WarningSink without_repeats(WarningSink sink) {
  if (!sink) return sink;
  struct Past {
    std::mutex mutex = {};
    std::set<std::string> seen = {};
  };
  return [sink = std::move(sink), past = std::make_shared<Past>()](const std::string& message) {
    const std::lock_guard lock(past->mutex);
    if (past->seen.insert(message).second) sink(message);
  };
}

}  // namespace fieldtrace
