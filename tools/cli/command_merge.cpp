// `fieldtrace merge`: the parts of `fieldtrace render --slice` to one picture.
#include <fmt/format.h>

#include <atomic>

#include "hybrid/film/part.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"

namespace fieldtrace {

namespace {

struct MergeArguments {
  std::vector<std::string> parts, outputs;
  float exposure = 0.0f;
  bool float32 = false;
};

int run_merge(const MergeArguments& arguments, const std::string& command) {
  std::vector<OutputFile> outputs;
  for (const std::string& path : arguments.outputs) {
    require_image_writable(path);
    outputs.push_back({"-o", path});
  }
  require_distinct_files(outputs, arguments.parts);
  const std::atomic<bool>& stop = stop_on_interrupt();
  MergedPicture merged = merge_parts(arguments.parts);
  ImageWriteOptions options;
  options.exposure = arguments.exposure;
  options.half = !arguments.float32;
  for (const char* name : {"fieldtrace:version", "fieldtrace:seed", "fieldtrace:spp"})
    options.metadata[name] = merged.metadata[name];
  options.metadata["fieldtrace:command"] = command;
  options.metadata["fieldtrace:part_command"] = merged.metadata["fieldtrace:command"];
  Writes writes;
  for (const std::string& path : arguments.outputs) {
    if (stop) {
      writes.rethrow();
      return report_interrupted(path);
    }
    writes.attempt([&] { write_image(path, merged.image, options); });
  }
  writes.rethrow();
  return k_exit_success;
}

}  // namespace

void add_merge_command(CommandLine& line) {
  const auto arguments = std::make_shared<MergeArguments>();
  CLI::App& command = *line.app.add_subcommand("merge", "Join the parts of a picture that render --slice wrote");
  command.add_option("parts", arguments->parts, "All parts of one picture, in any order")
      ->required()
      ->type_name("PART.exr");
  command.add_option("-o", arguments->outputs, "Image to write, .exr or .png; may be repeated")
      ->required()
      ->type_name("OUT")
      ->allow_extra_args(false);
  add_exposure_option(command, arguments->exposure);
  command.add_flag("--float32", arguments->float32, "Write EXR as 32-bit float instead of 16-bit half");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_merge(*arguments, line.text); }; });
}

}  // namespace fieldtrace
