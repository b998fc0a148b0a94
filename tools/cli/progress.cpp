#include "tools/cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

constexpr auto k_redraw_interval = std::chrono::milliseconds(100);

// Below this share an estimate of the remaining time would be mostly noise.
constexpr double k_share_for_estimate = 0.02;

std::string minutes(double seconds) {
  const int s = int(std::min(seconds, 359999.0) + 0.5);
  if (s >= 3600) return fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
  return fmt::format("{}:{:02}", s / 60, s % 60);
}

}  // namespace

ProgressLine::ProgressLine(bool enabled) : enabled_(enabled && isatty(STDERR_FILENO)) {}

void ProgressLine::update(double share, const std::string& stage) {
  if (!enabled_) return;
  const Clock::time_point now = Clock::now();
  if (drawn_ && now - last_draw_ < k_redraw_interval) return;
  last_draw_ = now;
  drawn_ = true;
  const double done = std::clamp(share, 0.0, 1.0);
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  std::string line = fmt::format("{:3.0f} %  {}  {} elapsed", 100.0 * done, stage, minutes(elapsed));
  if (done >= k_share_for_estimate) line += fmt::format(", {} left", minutes(elapsed * (1.0 - done) / done));
  print_message("\r{}\033[K", line);
  std::fflush(stderr);
}

void ProgressLine::clear() {
  if (!drawn_) return;
  drawn_ = false;
  print_message("\r\033[K");
  std::fflush(stderr);
}

void ProgressLine::restart() {
  clear();
  start_ = Clock::now();
}

}  // namespace fieldtrace
