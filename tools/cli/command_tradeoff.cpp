// `fieldtrace tradeoff`: speed against accuracy of one scene, as tables and a page.
#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/io/atomic_file.h"
#include "hybrid/compare/tradeoff.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"
#include "tools/report/tradeoff_page.h"

namespace fieldtrace {

namespace {

namespace fs = std::filesystem;

struct TradeoffArguments {
  SceneArguments scene;
  std::string folder;
  TradeoffPlanOptions plan;
  bool quiet = false;
};

// Written row by row under a name that marks it as partial, so that a crash loses nothing. The first row, with the
// head, replaces the rows that an interrupted run has left there. Rows are kept if a later one cannot be written or
// never comes.
class GrowingTable {
 public:
  explicit GrowingTable(const fs::path& final_path)
      : final_path_(final_path), partial_path_(final_path.string() + ".partial") {}

  void add(const std::string& row) {
    const uint64_t whole = text_.size();
    if (whole == 0) text_ = tradeoff_csv_header() + "\n";
    text_ += row + "\n";
    std::ofstream out(partial_path_, std::ios::binary | (whole > 0 ? std::ios::app : std::ios::trunc));
    const bool is_open = out.is_open();
    out << text_.substr(whole);
    out.close();
    if (out) return;
    const std::string reason = std::strerror(errno);
    text_.resize(whole);
    if (is_open) drop_half_row();
    throw Error({partial_path_.string()},
                "cannot be written: " + reason + (has_rows() ? "; the rows so far are kept" : ""));
  }
  bool has_rows() const { return !text_.empty(); }
  // Written again as a whole: only a verified table replaces an older one.
  void finish() {
    write_text_file(final_path_.string(), text_);
    std::error_code ignored;
    fs::remove(partial_path_, ignored);
  }
  std::string partial_path() const { return partial_path_.string(); }

 private:
  // Truncates the file to the rows that were written whole.
  void drop_half_row() const {
    std::error_code ignored;
    if (has_rows())
      fs::resize_file(partial_path_, text_.size(), ignored);
    else
      fs::remove(partial_path_, ignored);
  }

  fs::path final_path_, partial_path_;
  std::string text_;
};

std::string what_is_left(const GrowingTable& table, const Image& reference, const std::string& reference_path) {
  if (table.has_rows()) return fmt::format("the rows so far are in {}", table.partial_path());
  if (reference.data.empty()) return "nothing was written: the reference was not finished";
  return fmt::format("no row was finished, only {} was written", reference_path);
}

int run_command(const TradeoffArguments& arguments, const std::string& command) {
  make_folder(arguments.folder);
  const fs::path folder = arguments.folder;
  const std::string reference_path = (folder / "reference.exr").string();
  const std::string table_path = (folder / "tradeoff.csv").string();
  const std::string parts_path = (folder / "bias.csv").string();
  const std::string page_path = (folder / "tradeoff.html").string();
  for (const std::string& path : {reference_path, table_path, table_path + ".partial", parts_path, page_path})
    require_writable(path);
  ProgressLine progress(!arguments.quiet);
  const Scene scene = load_scene(arguments.scene, progress);
  const OutputFile outputs[] = {{"-o", reference_path},
                                {"-o", table_path},
                                {"-o", table_path + ".partial"},
                                {"-o", parts_path},
                                {"-o", page_path}};
  require_distinct_files(outputs, scene.files);
  GrowingTable table(table_path);

  TradeoffCallbacks callbacks;
  callbacks.render.stop = &stop_on_interrupt();
  callbacks.render.warning = print_warnings(progress);
  callbacks.render.progress = [&](float share, const char* stage) { progress.update(share, stage); };
  // At once, because nothing takes longer to render than the reference.
  callbacks.reference = [&](const Image& image) {
    ImageWriteOptions options;
    options.half = false;
    write_image(reference_path, image, options);
  };
  const TradeoffPlan plan = make_tradeoff_plan(scene, arguments.plan);
  TradeoffReport report;
  report.scene = arguments.scene.path, report.command = command;
  report.machine = machine_text(), report.version = FIELDTRACE_VERSION;
  report.reference_spp = plan.reference.spp;
  // A ladder's Monte Carlo rows come before those that are compared with them.
  callbacks.row = [&](const TradeoffRow& row, const Image& image) {
    report.add(row, image, plan.targets.size() / 2);
    table.add(report.lines.back());
  };
  std::string parts_table = parts_csv_header() + "\n";
  callbacks.parts = [&](const TradeoffParts& parts) {
    report.parts.push_back(parts);
    parts_table += parts_csv_row(parts) + "\n";
  };
  TradeoffReference reference;
  const bool complete = run_tradeoff(scene, plan, arguments.folder, reference, callbacks);
  progress.clear();
  if (!complete) {
    print_message("fieldtrace: interrupted; {}\n", what_is_left(table, reference.image, reference_path));
    return k_exit_interrupted;
  }
  table.finish();
  write_text_file(parts_path, parts_table);
  report.reference = std::move(reference.image);
  write_text_file(page_path, tradeoff_page(report, arguments.folder));
  if (!arguments.quiet) print_message("{} and the tables and the reference beside it written\n", page_path);
  return k_exit_success;
}

}  // namespace

void add_tradeoff_command(CommandLine& line) {
  const auto arguments = std::make_shared<TradeoffArguments>();
  CLI::App& command = *line.app.add_subcommand("tradeoff", "Measure speed against accuracy over one scene");
  add_scene_options(command, arguments->scene);
  command.add_option("-o", arguments->folder, "Folder to write, made if missing")->required()->type_name("DIR");
  command.add_flag("--quick", arguments->plan.quick, "Few samples and field resolutions, a coarser reference");
  add_threads_option(command, arguments->plan.base.threads);
  command.add_flag("--quiet", arguments->quiet, "No progress and no summary");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_command(*arguments, line.text); }; });
}

}  // namespace fieldtrace
