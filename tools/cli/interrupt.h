// Ending long work early on SIGINT (Ctrl-C) and SIGTERM.
//
// Thread-safety: the flag is lock-free and may be read from any thread.
#pragma once

#include <atomic>
#include <string>

namespace fieldtrace {

// Installs the handlers and returns the flag that they set. The first signal only sets the flag, so that the work can
// stop in order and write what is finished; a second one ends the program at once.
const std::atomic<bool>& stop_on_interrupt();

// Says that `file` was not written, and returns the exit code for that.
int report_interrupted(const std::string& file);

}  // namespace fieldtrace
