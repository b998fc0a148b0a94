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

// Unless it has nothing but its head: what an earlier run has written stays. Returns whether it has rows.
bool write_rows(const fs::path& path, const std::string& table) {
  const bool has_rows = table.find('\n') + 1 < table.size();
  if (has_rows) write_text_file(path.string(), table);
  return has_rows;
}

int run_command(const ThesisArguments& arguments, const std::string& command) {
  const fs::path folder = arguments.folder;
  make_folder(arguments.folder);
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
  // What is finished is written, whatever fails.
  Writes writes;
  writes.attempt([&] { tbb::task_arena(threads).execute([&] { complete = run_thesis(options, callbacks, report); }); });
  progress.clear();

  bool has_rows = false;
  const std::pair<const char*, std::string> tables[] = {{"thesis.csv", thesis_csv(report)},
                                                        {"growth.csv", thesis_growth_csv(report)},
                                                        {"charts.csv", thesis_charts_csv(report)},
                                                        {"hybrid.csv", thesis_hybrid_csv(report)}};
  for (const auto& [name, table] : tables) {
    writes.attempt([&, name = name, &table = table] { has_rows |= write_rows(folder / name, table); });
  }
  writes.attempt([&] {
    if (has_rows) write_text_file(page, thesis_page(report, command, FIELDTRACE_VERSION));
  });
  writes.rethrow();
  if (!complete) {
    print_message("fieldtrace: interrupted; {}\n",
                  has_rows ? "what was finished is in " + page : "nothing was written: no row was finished");
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
  add_threads_option(command, arguments->threads);
  command.add_flag("--quiet", arguments->quiet, "No progress and no summary");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_command(*arguments, line.text); }; });
}

}  // namespace fieldtrace
