#include "tools/cli/output_files.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>

#include "core/io/atomic_file.h"
#include "core/platform/error.h"

namespace fieldtrace {

void require_distinct_files(std::span<const OutputFile> outputs, std::span<const std::string> inputs) {
  std::map<std::string, const std::string*> inputs_by_identity;
  for (const std::string& input : inputs) inputs_by_identity.emplace(file_identity(input), &input);
  std::map<std::string, const OutputFile*> earlier;
  for (const OutputFile& output : outputs) {
    const std::string name = output.option + " " + output.path;
    const auto [other, is_new] = earlier.emplace(file_identity(output.path), &output);
    if (!is_new) {
      throw UsageError(name + ": the same file as " + other->second->option + " " + other->second->path +
                       "; write each to one of its own");
    }
    const auto input = inputs_by_identity.find(other->first);
    if (input != inputs_by_identity.end()) {
      throw UsageError(name + ": would overwrite the input " + *input->second + "; write to another file");
    }
  }
}

void make_folder(const std::string& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) throw Error({folder}, "the folder cannot be made: " + failed.message());
}

void Writes::rethrow() const {
  if (messages_.size() == 1) std::rethrow_exception(first_);
  if (!messages_.empty()) throw Error(fmt::format("{}", fmt::join(messages_, "; ")));
}

}  // namespace fieldtrace
