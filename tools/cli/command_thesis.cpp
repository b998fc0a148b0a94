// `fieldtrace thesis`: the tables of the thesis' section 4 on this machine.
#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <filesystem>

#include "core/io/atomic_file.h"
#include "core/platform/threads.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"
#include "tools/thesis/measure.h"
#include "tools/thesis/report.h"

namespace fieldtrace {

namespace {

namespace fs = std::filesystem;

struct ThesisArguments {
  std::string folder;
  ThesisRunOptions options;
  int threads = 0;
  bool quiet = false;
};

int run_command(const ThesisArguments& arguments, const std::string& command) {
  const fs::path folder = arguments.folder;
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) throw Error({arguments.folder}, "the folder cannot be made: " + failed.message());
  const std::string page = (folder / "thesis.html").string();
  std::vector<OutputFile> outputs;
  for (const char* name : {"thesis.csv", "growth.csv", "charts.csv", "hybrid.csv", "thesis.html"}) {
    outputs.push_back({"-o", (folder / name).string()});
    require_writable(outputs.back().path);
  }
  require_distinct_files(outputs, {{arguments.options.bunny}});

  ProgressLine progress(!arguments.quiet);
  ThesisRunOptions options = arguments.options;
  options.scratch_folder = arguments.folder;
  ThesisRunCallbacks callbacks;
  callbacks.stop = &stop_on_interrupt();
  callbacks.progress = [&](double share, const std::string& stage) { progress.update(share, stage); };
  ThesisReport report;
  bool complete = false;
  const int threads = threads_or_all(arguments.threads);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
  tbb::task_arena(threads).execute([&] { complete = run_thesis(options, callbacks, report); });
  progress.clear();

  write_text_file((folder / "thesis.csv").string(), thesis_csv(report));
  write_text_file((folder / "growth.csv").string(), thesis_growth_csv(report));
  write_text_file((folder / "charts.csv").string(), thesis_charts_csv(report));
  write_text_file((folder / "hybrid.csv").string(), thesis_hybrid_csv(report));
  write_text_file(page, thesis_page(report, command, FIELDTRACE_VERSION));
  if (!complete) {
    print_message("fieldtrace: interrupted; what was finished is in {}\n", page);
    return k_exit_interrupted;
  }
  if (!arguments.quiet) print_message("{} and the tables beside it written\n", page);
  return k_exit_success;
}

}  // namespace

void add_thesis_command(CommandLine& line) {
  const auto arguments = std::make_shared<ThesisArguments>();
  CLI::App& command = *line.app.add_subcommand("thesis", "Reproduce the thesis' tables of 2008 on this machine");
  command.add_option("-o", arguments->folder, "Folder to write, made if missing")->required()->type_name("DIR");
  command.add_flag("--quick", arguments->options.quick, "Small pictures, M = 32 only");
  command.add_option("--bunny", arguments->options.bunny, "The bunny's mesh; without it a torus knot takes its place")
      ->type_name("MESH")
      ->check(not_empty());
  command.add_option("--threads", arguments->threads, "Threads (default: 0, all)")
      ->transform(thread_count())
      ->type_name("N");
  command.add_flag("--quiet", arguments->quiet, "No progress and no summary");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_command(*arguments, line.text); }; });
}

}  // namespace fieldtrace
