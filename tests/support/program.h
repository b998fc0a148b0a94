// Runs the built program as a user would, with its own process, files and exit code.
//
// Thread-safety: one thread at a time.
#pragma once

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/waiting.h"

namespace fieldtrace::test {

inline std::string read_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

struct Outcome {
  int code = -1;  // exit code; 128 + signal if one ended the program
  std::string out, err;
  uint64_t peak_bytes = 0;  // resident memory; no less than this process had when it started the program
};

class Program {
 public:
  // Starts the program, or the one at `path`, in `folder`, which also receives its output (in files whose names begin
  // with a dot). `prepare` runs in the new process just before.
  Program(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
          std::string path = FIELDTRACE_PROGRAM, const std::function<void()>& prepare = {})
      : folder_(folder) {
    std::vector<char*> argv;
    argv.push_back(path.data());
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    const std::string out = (folder / ".out").string(), err = (folder / ".err").string();
    child_ = fork();
    if (child_ == 0) {
      if (chdir(folder.c_str()) != 0 || !freopen(out.c_str(), "w", stdout) || !freopen(err.c_str(), "w", stderr)) {
        _exit(126);
      }
      if (prepare) prepare();
      execv(argv[0], argv.data());
      _exit(127);
    }
  }

  Outcome wait() {
    int status = 0;
    rusage usage{};
    wait4(child_, &status, 0, &usage);
    Outcome outcome;
    outcome.peak_bytes = uint64_t(usage.ru_maxrss) * 1024;  // Linux counts in units of 1024 bytes
    outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.out = read_text(folder_ / ".out");
    outcome.err = read_text(folder_ / ".err");
    return outcome;
  }

  void kill_now() const { kill(child_, SIGKILL); }

  // Waits until the program handles SIGINT itself, then sends it. False if that does not happen within 20 s.
  bool interrupt() const {
    return comes_true([&] { return handles_interrupts(); }) && kill(child_, SIGINT) == 0;
  }

 private:
  bool handles_interrupts() const {
    std::istringstream lines(read_text("/proc/" + std::to_string(child_) + "/status"));
    for (std::string word; lines >> word;) {
      if (word != "SigCgt:") continue;
      lines >> word;
      return (std::stoull(word, nullptr, 16) >> (SIGINT - 1)) & 1;
    }
    return false;
  }

  std::filesystem::path folder_;
  pid_t child_ = -1;
};

}  // namespace fieldtrace::test
