#include "tools/cli/interrupt.h"

#include <csignal>

#include "tools/cli/command.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

// A signal handler has no argument to pass state by, hence the one global of the program.
std::atomic<bool> stop_flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

void on_signal(int signal) {
  if (stop_flag.exchange(true)) {
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
}

}  // namespace

const std::atomic<bool>& stop_on_interrupt() {
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  return stop_flag;
}

int report_interrupted(const std::string& file) {
  print_message("fieldtrace: interrupted; {} was not written\n", file);
  return k_exit_interrupted;
}

}  // namespace fieldtrace
