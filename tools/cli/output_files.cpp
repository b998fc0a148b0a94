#include "tools/cli/output_files.h"

#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace {

namespace {

namespace fs = std::filesystem;

bool is_same_file(const std::string& a, const std::string& b) {
  std::error_code failed;
  if (fs::equivalent(a, b, failed) && !failed) return true;
  std::error_code failed_a, failed_b;
  // weakly_canonical() leaves a relative path unchanged if no part of it exists.
  const fs::path path_a = fs::weakly_canonical(fs::absolute(a, failed_a), failed_a);
  const fs::path path_b = fs::weakly_canonical(fs::absolute(b, failed_b), failed_b);
  return failed_a || failed_b ? a == b : path_a == path_b;
}

}  // namespace

void require_distinct_files(std::span<const OutputFile> outputs, std::span<const std::string> inputs) {
  for (size_t i = 0; i < outputs.size(); ++i) {
    const OutputFile& output = outputs[i];
    const std::string name = output.option + " " + output.path;
    for (const OutputFile& other : outputs.first(i)) {
      if (!is_same_file(output.path, other.path)) continue;
      throw UsageError(name + ": the same file as " + other.option + " " + other.path +
                       "; write each to one of its own");
    }
    for (const std::string& input : inputs) {
      if (!is_same_file(output.path, input)) continue;
      throw UsageError(name + ": would overwrite the input " + input + "; write to another file");
    }
  }
}

}  // namespace fieldtrace
