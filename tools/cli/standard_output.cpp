#include "tools/cli/standard_output.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

namespace fieldtrace {

void prepare_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) >= 0 || errno != EBADF) continue;
    const int held = open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
    if (held >= 0 && held != stream) close(held);
  }
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  // Longer than any help text, so that what fails is the flush at the end, which knows the reason.
  static char buffer[size_t(1) << 16];
  if (!isatty(STDOUT_FILENO)) std::setvbuf(stdout, buffer, _IOFBF, sizeof(buffer));
}

std::string flush_standard_output() {
  if (std::fflush(stdout) != 0) return std::strerror(errno);
  if (std::ferror(stdout) != 0) return "an earlier write failed";
  // Network file systems may report errors only on closing a descriptor; this one has to stay open.
  const int copy = dup(STDOUT_FILENO);
  if (copy >= 0 && close(copy) != 0) return std::strerror(errno);
  return {};
}

std::string standard_output_message(const std::string& reason) {
  return "standard output: cannot be written: " + reason;
}

}  // namespace fieldtrace
