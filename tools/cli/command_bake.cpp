// `fieldtrace bake`: bakes the field of one object, or of a scene's objects, ahead of rendering.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/io/atomic_file.h"
#include "core/io/file_ending.h"
#include "core/io/input_file.h"
#include "core/loader/scene_limits.h"
#include "core/mesh/mesh_io.h"
#include "hybrid/bake/bake_scene.h"
#include "hybrid/fields/field_resolution.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/visibility/shape_traits.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

// Shadow rays of an image of 1024 x 1024 pixels with 64 light samples.
constexpr uint64_t k_large_picture_rays = uint64_t(1024) * 1024 * 64;

struct BakeArguments {
  SceneArguments input;
  std::string output;
  BakeOptions options;
  int directions = 0, plane = 0;  // 0: as `render` would choose for k_large_picture_rays
};

bool is_mesh(const std::string& path) {
  const std::string ending = file_ending(path);
  return ending == ".obj" || ending == ".ply";
}

// OpenVDB programs require the extension; a folder is a field cache.
void check_output(const std::string& path) {
  if (is_folder(path) || std::filesystem::path(path).extension() == ".vdb") return;
  throw UsageError("-o " + path + ": name a file ending in .vdb, or a folder that exists");
}

void check_limit(const BakeArguments& arguments) {
  if (arguments.options.cache_limit == 0 || is_folder(arguments.output)) return;
  throw UsageError("--field-cache-limit: -o must name a folder that exists, " + arguments.output + " is none");
}

// The numbered files of all objects that may get a field. Those in a cache are named by what they hold.
void check_numbered_outputs(const BakeArguments& arguments, const Scene& scene,
                            const std::vector<ShapeTraits>& traits) {
  if (is_folder(arguments.output)) return;
  const auto wanted = size_t(std::count_if(traits.begin(), traits.end(), [](const auto& t) { return t.wants_field; }));
  std::vector<OutputFile> outputs;
  for (size_t i = 0; i < std::max<size_t>(wanted, 1); ++i) {
    outputs.push_back({"-o", numbered_path(arguments.output, i)});
  }
  std::vector<std::string> inputs = scene.files;
  inputs.push_back(arguments.input.path);  // a mesh alone has no scene file
  require_distinct_files(outputs, inputs);
  for (const OutputFile& output : outputs) require_writable(output.path);
}

std::string summary(const FieldFileInfo& info) {
  const FieldParameters& p = info.header.identity.parameters;
  return fmt::format("{} x {} cells, {} baked, {} coverage tiles, {:.1f} MB", p.directions, p.plane,
                     info.visibility.cells_baked + info.depth.cells_baked, info.coverage.tiles_baked,
                     double(info.bytes_disk) * 1e-6);
}

std::string summary(const ThesisFileInfo& info) {
  return fmt::format("M = {}, {} samples of the chart thesis, {:.1f} MB", info.header.identity.parameters.directions,
                     info.samples, double(info.bytes_disk) * 1e-6);
}

int run_bake(const BakeArguments& arguments) {
  check_output(arguments.output);
  check_limit(arguments);
  const bool mesh = is_mesh(arguments.input.path);
  const bool by_thesis = arguments.options.chart == Chart::thesis;
  if (mesh) refuse_scene_reading_options(arguments.input);
  if (mesh && !arguments.options.full && !by_thesis) {
    throw UsageError("a mesh alone demands no cells; bake it with --full, or name a scene");
  }
  const std::atomic<bool>& stop = stop_on_interrupt();
  ProgressLine progress(true);
  RenderCallbacks callbacks;
  callbacks.progress = [&progress](float share, const char* stage) { progress.update(share, stage); };
  callbacks.warning = print_warnings(progress);
  callbacks.stop = &stop;
  progress.update(0.0, "loading");
  const Scene scene = mesh ? scene_of_mesh(load_mesh(arguments.input.path, {}, callbacks.warning),
                                           std::filesystem::path(arguments.input.path).filename().string())
                           : load_scene(arguments.input, progress);
  // For scenes, load_scene() has checked this.
  if (mesh)
    check_scene_limits(scene, {.instances = {{arguments.input.path}}, .emitters = {}, .camera = {}, .scene = {}});
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  check_numbered_outputs(arguments, scene, traits);
  BakeOptions options = arguments.options;
  if (by_thesis) options.thesis_directions = thesis_directions(arguments.directions, arguments.plane);
  options.fields = choose_resolution(scene, traits, k_large_picture_rays);
  if (arguments.directions) options.fields.directions = arguments.directions;
  if (arguments.plane) options.fields.plane = arguments.plane;
  const BakeResult result = bake_scene(scene, arguments.output, options, callbacks);
  progress.clear();
  for (const BakedField& field : result.fields) {
    fmt::print("{}: {}, {}\n", field.path, field.object,
               std::visit([](const auto& info) { return summary(info); }, field.info));
  }
  if (result.fields.empty() && !result.interrupted)
    fmt::print("nothing written: the scene's shadow rays demand no field\n");
  if (!result.interrupted) return k_exit_success;
  print_message("fieldtrace: interrupted; {}\n",
                result.fields.empty() ? "nothing was written" : "the finished cells were written");
  return k_exit_interrupted;
}

}  // namespace

void add_bake_command(CommandLine& line) {
  const auto arguments = std::make_shared<BakeArguments>();
  CLI::App& command = *line.app.add_subcommand("bake", "Bake displacement fields ahead of rendering");
  command.add_option("input", arguments->input.path, "Scene or mesh")->required()->type_name("SCENE.xml|MESH");
  command
      .add_option("-o", arguments->output,
                  "Field to write, further objects as FIELD.2.vdb and so on; or a folder for render --field-cache")
      ->required()
      ->type_name("FIELD.vdb|DIR");
  command.add_flag("--full", arguments->options.full,
                   "Bake every cell, not only those that the scene demands (thesis: always)");
  command.add_option("--directions", arguments->directions, "Direction cells D (default: from the scene's lights)")
      ->check(field_directions())
      ->type_name("D");
  command.add_option("--plane", arguments->plane, "Plane cells N (default: from the scene's lights)")
      ->check(field_plane())
      ->type_name("N");
  add_chart_option(command, arguments->options.chart);
  add_memory_option(command, arguments->options.field_memory);
  add_cache_limit_option(command, arguments->options.cache_limit);
  add_threads_option(command, arguments->options.threads);
  add_scene_reading_options(command, arguments->input);
  command.callback([arguments, &line] { line.action = [arguments] { return run_bake(*arguments); }; });
}

}  // namespace fieldtrace
