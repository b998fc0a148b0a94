// The demo: one scene by both methods, their pictures and one table. Run by tools/demo.sh.
//
// usage: fieldtrace_demo SCENE.xml -o DIR [-D name=value] [--reference-spp N]
// DIR receives the reference (rendered once for each scene, and kept), the pictures and demo.csv.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>

#include "core/io/atomic_file.h"
#include "core/platform/stopwatch.h"
#include "field/file/hash.h"
#include "hybrid/compare/tradeoff.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

namespace fs = std::filesystem;

struct DemoArguments {
  SceneArguments scene;
  std::string folder;
  int reference_spp = 4096;
};

// Tells whether a kept reference belongs to this scene: a hash of all its files, its parameters and how it is rendered.
std::string fingerprint(const DemoArguments& arguments, const Scene& scene) {
  Hasher hasher;
  for (const std::string& file : scene.files) {
    if (!hasher.add_file(file)) throw Error({file}, "cannot be read again, to see which scene this is");
  }
  std::string text;
  for (const auto& [name, value] : scene.parameters) text += fmt::format("{}={}\n", name, value);
  text += fmt::format("{} {} {}", FIELDTRACE_VERSION, arguments.reference_spp, scene.seed);
  hasher.add(text.data(), text.size());
  return hasher.result().hex();
}

TradeoffPlan make_plan(const Scene& scene, int reference_spp) {
  TradeoffPlan plan;
  plan.reference.method = Method::monte_carlo;
  plan.reference.spp = reference_spp;
  plan.reference.seed = scene.seed + 1;
  for (const int spp : {4, 16, 64, 256}) {
    RenderOptions o;
    o.method = Method::monte_carlo;
    o.light_estimator = LightEstimator::adaptive;  // its best
    o.spp = spp;
    plan.cases.push_back({o});
  }
  for (const int spp : {4, 16, 64}) {
    RenderOptions o;
    o.method = Method::hybrid;
    o.spp = spp;
    plan.cases.push_back({o});
  }
  return plan;
}

std::string factor(const TimeAtError& monte_carlo, double seconds) {
  if (!std::isfinite(monte_carlo.seconds) || !(seconds > 0)) return "-";
  constexpr const char* k_relations[] = {"", ">", "<"};
  return fmt::format("{}{:.2f}x", k_relations[int(monte_carlo.relation)], monte_carlo.seconds / seconds);
}

// Who answered the light samples of a render, in per cent of all: nobody had to (nothing stood before the light), whole
// lights, strata, cells, rays.
std::string answered(const Stats& s) {
  const double all = std::max(double(s.samples), 1.0) / 100.0;
  const double open = double(s.samples) - double(s.rays_crossing) - double(s.samples_spared);
  return fmt::format("{:.1f} {:.1f} {:.1f} {:.1f} {:.1f}", std::max(open, 0.0) / all,
                     double(s.samples_by_clusters()) / all, double(s.samples_by_strata) / all,
                     double(s.samples_by_cells()) / all, double(s.rays_exact) / all);
}

void print_table(const std::vector<TradeoffRow>& rows, double load_seconds) {
  const std::vector<ErrorPoint> monte_carlo = monte_carlo_points(rows);
  fmt::print("{:<12}{:>8}{:>8}{:>8}{:>8}{:>10}{:>20}{:>28}\n", "method", "samples", "cold", "warm", "bake", "RMSE",
             "speed-up cold/warm", "open whole strata cell ray");
  for (const TradeoffRow& row : rows) {
    const Stats& s = row.cold;
    const bool hybrid = row.options.method == Method::hybrid;
    const TimeAtError equal = seconds_at_error(monte_carlo, row.difference.rmse);
    fmt::print("{:<12}{:>8}{:>8.2f}{:>8.2f}{:>8.2f}{:>10.5f}{:>20}{:>28}\n", hybrid ? "hybrid" : "montecarlo", s.spp,
               row.seconds_cold, row.seconds_warm, s.time_bake, row.difference.rmse,
               hybrid ? factor(equal, row.seconds_cold) + " / " + factor(equal, row.seconds_warm) : "-", answered(s));
  }
  fmt::print(
      "\nSamples: camera samples of one light sample a light. Seconds: wall time of whole frames, without\n"
      "{:.2f} s of loading; cold with the bake, warm with the fields of an earlier render. Speed-up: time that\n"
      "Monte Carlo needs for the same RMSE / time of the hybrid; below 1: slower. > and <: the error lies below,\n"
      "or above, all that Monte Carlo was measured at. The last five columns: light samples in per cent, by what\n"
      "answered them: nothing stood before the light; whole lights; strata of lights; certified cells; exact rays.\n",
      load_seconds);
}

// Without the extension.
std::string picture_name(const RenderOptions& options) {
  return fmt::format("{}-{}", options.method == Method::hybrid ? "hybrid" : "montecarlo", options.spp);
}

void write_pictures(const fs::path& folder, const TradeoffRow& row, const Image& image) {
  const std::string name = picture_name(row.options);
  write_image((folder / (name + ".exr")).string(), image);
  write_image((folder / (name + ".png")).string(), image);
}

void check_inputs_survive(const fs::path& folder, const std::string& reference_path, const TradeoffPlan& plan,
                          const std::vector<std::string>& inputs) {
  std::vector<OutputFile> outputs = {{"-o", reference_path}};
  std::vector<std::string> names = {"demo.csv", "reference.png"};
  for (const TradeoffCase& c : plan.cases) {
    for (const char* extension : {".exr", ".png"}) names.push_back(picture_name(c.options) + extension);
  }
  for (const std::string& name : names) outputs.push_back({"-o", (folder / name).string()});
  require_distinct_files(outputs, inputs);
}

int run_demo(const DemoArguments& arguments) {
  const fs::path folder = arguments.folder;
  make_folder(arguments.folder);
  require_writable((folder / "demo.csv").string());

  ProgressLine progress(true);
  const auto start = std::chrono::steady_clock::now();
  const Scene scene = load_scene(arguments.scene, progress);
  const double load_seconds = seconds_since(start);
  const TradeoffPlan plan = make_plan(scene, arguments.reference_spp);
  const std::string reference_path = (folder / fmt::format("reference-{}.exr", fingerprint(arguments, scene))).string();
  check_inputs_survive(folder, reference_path, plan, scene.files);

  TradeoffCallbacks callbacks;
  callbacks.render.stop = &stop_on_interrupt();
  callbacks.render.warning = print_warnings(progress);
  callbacks.render.progress = [&](float share, const char* stage) { progress.update(share, stage); };

  // Rendered first and kept at once, so that an interrupted demo does not lose its most expensive part.
  TradeoffReference reference;
  if (fs::exists(reference_path)) {
    reference.image = read_image(reference_path);
  } else {
    TradeoffPlan reference_only;
    reference_only.reference = plan.reference;
    if (!run_tradeoff(scene, reference_only, arguments.folder, reference, callbacks)) return k_exit_interrupted;
    ImageWriteOptions options;
    options.half = false;
    write_image(reference_path, reference.image, options);
    write_image((folder / "reference.png").string(), reference.image);
  }

  progress.restart();
  std::vector<TradeoffRow> rows;
  callbacks.row = [&](const TradeoffRow& row, const Image& image) {
    rows.push_back(row);
    write_pictures(folder, row, image);
  };
  const bool complete = run_tradeoff(scene, plan, arguments.folder, reference, callbacks);
  progress.clear();
  std::string csv = tradeoff_csv_header() + "\n";
  for (const TradeoffRow& row : rows) csv += tradeoff_csv_row(row, monte_carlo_points(rows)) + "\n";
  write_text_file((folder / "demo.csv").string(), csv);
  print_table(rows, load_seconds);
  return complete ? k_exit_success : k_exit_interrupted;
}

}  // namespace

}  // namespace fieldtrace

int main(int argc, char** argv) {
  using namespace fieldtrace;
  prepare_streams();
  DemoArguments arguments;
  CLI::App app("One scene by both methods: pictures and a table");
  add_scene_options(app, arguments.scene);
  app.add_option("-o", arguments.folder, "Folder to write, made if missing")->required()->type_name("DIR");
  app.add_option("--reference-spp", arguments.reference_spp, "Samples of the reference (default: 4096)")
      ->check(whole_number_between(1, 1 << 20))
      ->type_name("N");
  CLI11_PARSE(app, argc, argv);
  try {
    const int code = run_demo(arguments);
    const std::string failure = flush_standard_output();
    if (!failure.empty()) throw Error(standard_output_message(failure));
    return code;
  } catch (const std::exception& e) {
    fmt::print(stderr, "fieldtrace_demo: {}\n", e.what());
    return k_exit_input;
  }
}
