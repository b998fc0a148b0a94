// `fieldtrace render`: one scene to images and statistics.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <optional>

#include "core/io/atomic_file.h"
#include "core/io/file_ending.h"
#include "core/platform/stopwatch.h"
#include "hybrid/denoise/denoise.h"
#include "hybrid/render/picture.h"
#include "hybrid/render/picture_identity.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/picture_watcher.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"
#include "tools/cli/tev_viewer.h"

namespace fieldtrace {

namespace {

using Clock = std::chrono::steady_clock;

struct RenderArguments {
  SceneArguments scene;
  RenderOptions options;
  std::vector<std::string> outputs;
  std::string crop;
  std::string stats_file;
  float exposure = 0.0f;
  bool float32 = false;
  bool denoise = false;
  bool skip_done = false;
  std::optional<ViewerAddress> viewer;
  bool watch = false;
  bool quiet = false;
};

std::vector<OutputFile> outputs_of(const RenderArguments& arguments) {
  std::vector<OutputFile> outputs;
  for (const std::string& path : arguments.outputs) outputs.push_back({"-o", path});
  if (!arguments.stats_file.empty()) outputs.push_back({"--stats", arguments.stats_file});
  if (!arguments.options.checkpoint.empty()) outputs.push_back({"--checkpoint", arguments.options.checkpoint});
  return outputs;
}

// The checkpoint that is resumed may be written again as the new one alone.
void require_resumed_survives(const RenderArguments& arguments) {
  if (arguments.options.resume.empty()) return;
  std::vector<OutputFile> outputs = outputs_of(arguments);
  std::erase_if(outputs, [](const OutputFile& output) { return output.option == "--checkpoint"; });
  require_distinct_files(outputs, {{arguments.options.resume}});
}

void require_outputs_writable(const RenderArguments& arguments) {
  for (const std::string& path : arguments.outputs) require_image_writable(path);
  if (!arguments.stats_file.empty()) require_writable(arguments.stats_file);
  if (!arguments.options.checkpoint.empty()) require_writable(arguments.options.checkpoint);
}

// A part is one file, whose slice another command joins: nothing that needs the whole picture.
void require_slice_alone(const RenderArguments& arguments) {
  if (!arguments.options.slice) return;
  if (arguments.options.keeps_sums())
    throw UsageError("--slice is for pictures of --spp samples: no target error, time limit, checkpoint");
  if (arguments.denoise)
    throw UsageError("--denoise needs the whole picture, of which --slice renders a part; give one of them");
  if (arguments.outputs.size() > 1) throw UsageError("--slice writes one part; give one -o");
  if (file_ending(arguments.outputs[0]) != ".exr")
    throw UsageError("-o " + arguments.outputs[0] + ": parts are EXR files; end the name in .exr");
}

// Rendered by that chart, each camera sample takes --light-samples, hidden lights or not.
void require_estimator_of_chart(const RenderOptions& options) {
  if (options.chart == Chart::thesis && options.light_estimator == LightEstimator::adaptive)
    throw UsageError("--light-estimator adaptive: not with --chart thesis; give one of them");
}

// Denoises the picture and removes the layers that nobody asked for. Returns what denoised it; empty: nothing did.
std::string denoise_result(const RenderArguments& arguments, const Scene& scene, RenderResult& result,
                           const WarningSink& warning) {
  const ScopedTimer timer(result.stats.time_denoise);
  std::string denoiser;
  try {
    denoiser = denoise(result.image, {arguments.options.threads, scene.camera.aperture_radius > 0.0f});
  } catch (const std::exception& error) {
    warn(warning, {}, std::string(error.what()) + "; the picture is written with its noise");
  }
  drop_denoise_layers(result.image, arguments.options.aovs);
  return denoiser;
}

void write_outputs(const RenderArguments& arguments, const RenderResult& result, const std::string& command,
                   const std::string& denoiser, Writes& writes) {
  ImageWriteOptions options;
  options.exposure = arguments.exposure;
  options.half = !arguments.float32;
  options.metadata = {{"fieldtrace:command", command},
                      {"fieldtrace:version", FIELDTRACE_VERSION},
                      {"fieldtrace:seed", std::to_string(result.stats.seed)},
                      {"fieldtrace:spp", std::to_string(result.stats.spp)}};
  if (result.interrupted) options.metadata["fieldtrace:interrupted"] = "1";
  if (!denoiser.empty()) options.metadata["fieldtrace:denoised"] = denoiser;
  if (result.part) {
    writes.attempt([&] { write_part(arguments.outputs[0], result.image, *result.part, options.metadata); });
    return;
  }
  for (const std::string& path : arguments.outputs) writes.attempt([&] { write_image(path, result.image, options); });
}

// Who shows the picture while it is rendered.
struct Previews {
  std::shared_ptr<LivePicture> picture;  // null: nobody
  std::optional<TevViewer> viewer;
  std::optional<PictureWatcher> watcher;
};

std::vector<std::string> watched_files(const RenderArguments& arguments) {
  std::vector<std::string> paths;
  if (!arguments.watch) return paths;
  for (const std::string& path : arguments.outputs) {
    if (file_ending(path) == ".png") paths.push_back(path);
  }
  if (paths.empty()) throw UsageError("--watch writes the PNG outputs, and there is none; add -o NAME.png");
  return paths;
}

void open_previews(const RenderArguments& arguments, const Rect& window, RenderCallbacks& callbacks,
                   Previews& previews) {
  if (!arguments.watch && !arguments.viewer) return;
  previews.picture = std::make_shared<LivePicture>(window.width, window.height);
  if (arguments.viewer)
    previews.viewer.emplace(*arguments.viewer, arguments.outputs[0], previews.picture, callbacks.warning);
  if (arguments.watch) {
    WatcherOptions options;
    options.paths = watched_files(arguments);
    options.exposure = arguments.exposure;
    previews.watcher.emplace(previews.picture, options, callbacks.warning);
  }
  callbacks.tile = [picture = previews.picture](const Rect& tile, std::span<const Rgb> pixels) {
    picture->update(tile, pixels);
  };
}

// Shows the viewer what became of the picture.
void show_result(const Image& image, LivePicture& picture) {
  std::vector<Rgb> pixels;
  const auto red = size_t(image.channel_index("R"));
  for (size_t i = red; i < image.data.size(); i += image.channel_count())
    pixels.emplace_back(image.data[i], image.data[i + 1], image.data[i + 2]);
  picture.update({0, 0, image.width, image.height}, pixels);
}

std::string count(uint64_t n) {
  if (n < 10000) return std::to_string(n);
  if (n < 10000000) return fmt::format("{:.1f} k", double(n) * 1e-3);
  if (n < 10000000000) return fmt::format("{:.1f} M", double(n) * 1e-6);
  return fmt::format("{:.1f} G", double(n) * 1e-9);
}

std::string megabytes(uint64_t bytes) { return fmt::format("{:.1f} MB", double(bytes) * 1e-6); }

std::string percent(uint64_t part, uint64_t all) {
  return fmt::format("{:.3g} %", all > 0 ? 100.0 * double(part) / double(all) : 0.0);
}

void print_checks(const Stats& s) {
  const char* title = "check ";
  for (int v = 0; v < k_checked_verdicts; ++v) {
    const uint64_t answers = s.check_by[v][0].answers + s.check_by[v][1].answers;
    const uint64_t wrong = s.check_by[v][0].wrong + s.check_by[v][1].wrong;
    if (answers == 0) continue;
    print_message("{}  {} of {} certified answers `{}` wrong ({})\n", title, wrong, answers, k_checked_verdict_names[v],
                  percent(wrong, answers));
    title = "      ";
  }
  for (int e = 0; e < k_checked_estimates; ++e) {
    const CheckedDifferences& d = s.check_estimates[e];
    if (d.compared == 0) continue;
    print_message("{}  {} compared with rays: {:.4f} in the mean, {:.2f} at most, bias {:+.4f} ({})\n", title,
                  k_checked_estimate_names[e], d.mean_difference(), d.worst_difference(), d.bias(), d.compared);
    title = "      ";
  }
}

// Which share of the light samples was answered how.
void print_answers(const Stats& s) {
  if (s.samples_spared == 0) return;
  print_message("light   samples: {} by whole lights, {} by strata, {} by cells, {} by rays\n",
                percent(s.samples_by_clusters(), s.samples), percent(s.samples_by_strata, s.samples),
                percent(s.samples_by_cells(), s.samples), percent(s.rays_exact, s.samples));
}

void print_summary(const Stats& s) {
  print_message("{}, {}x{}, {} spp x {} light sample{}, seed {}, {} thread{}, {}\n", s.method, s.width, s.height, s.spp,
                s.light_samples, s.light_samples == 1 ? "" : "s", s.seed, s.threads, s.threads == 1 ? "" : "s", s.isa);
  if (!s.slice.empty()) print_message("slice   {}\n", s.slice);
  print_message("scene   {} triangles, {} instances, {} lights\n", count(s.triangles), s.instances, s.lights);
  print_message("time    {:.2f} s: load {:.2f}, bake {:.2f}, primary {:.2f}, secondary {:.2f}\n", s.time_total,
                s.time_load, s.time_bake, s.time_primary, s.time_secondary);
  print_message("rays    {} primary, {} shadow ({} near an object), {} glossy\n", count(s.rays_primary),
                count(s.rays_shadow), count(s.rays_crossing), count(s.rays_glossy));
  if (s.by_rounds) {
    const std::string error = std::isfinite(s.error_estimate)
                                  ? fmt::format("{:.3g} estimated: noise {:.3g}, fields {:.3g}", s.error_estimate,
                                                s.error_noise, s.error_fields)
                                  : "not known";
    print_message("error   {}; {} rounds, {} to {} samples a pixel\n", error, s.rounds, s.samples_fewest,
                  s.samples_most);
  }
  if (s.field_objects > 0) {
    // The thesis' chart has no plane cells.
    const std::string cells = s.field_plane == 0 ? fmt::format("chart thesis, M = {}", s.field_directions)
                                                 : fmt::format("{} x {} cells", s.field_directions, s.field_plane);
    print_message("fields  {} object{}, {}, {} of {} baked, {} in memory\n", s.field_objects,
                  s.field_objects == 1 ? "" : "s", cells, count(s.field_cells_baked), count(s.field_cells_full),
                  megabytes(s.field_bytes_memory));
  } else if (s.field_restarts > 0) {
    print_message("fields  none: {} are too little for those that would gain\n", megabytes(s.field_bytes_budget));
  } else if (s.sky_objects == 0 && s.field_left_to_rays == 0 && s.method == "hybrid" && s.tolerance > 0) {
    print_message("fields  none: {}\n",
                  s.by_rounds ? "rays reach the error as soon, or no object suits one" : "no object suits one");
  }
  if (s.open_light_samples > s.light_samples && s.rays_open > 0)
    print_message("light   {} samples for each camera sample where it may be hidden\n", s.open_light_samples);
  if (s.sky_objects > 0) {
    print_message("sky     direction maps of {} object{}, {} x {} of {} x {} texels, {}\n", s.sky_objects,
                  s.sky_objects == 1 ? "" : "s", s.sky_directions, s.sky_directions, s.sky_texels, s.sky_texels,
                  megabytes(s.field_bytes_maps));
  }
  if (s.field_left_to_rays > 0) {
    print_message("left    {} object{} to exact rays for shadows: fields would gain too little\n", s.field_left_to_rays,
                  s.field_left_to_rays == 1 ? "" : "s");
  }
  if (s.field_self_to_rays > 0) {
    print_message("left    {} object{} to exact rays for shadows on themselves\n", s.field_self_to_rays,
                  s.field_self_to_rays == 1 ? "" : "s");
  }
  print_message("exact   {:.1f} % of the shadow rays near an object, {:.2f} objects a ray\n",
                100.0 * s.exact_fraction(), s.spheres_per_ray());
  if (s.rays_glossy > 0) {
    print_message("        {} of the glossy rays\n", percent(s.rays_glossy_exact, s.rays_glossy));
  }
  print_answers(s);
  print_checks(s);
  if (s.time_total > 0) {
    print_message("speed   {}rays/s, peak memory {}\n",
                  count(uint64_t(double(s.rays_primary + s.rays_shadow + s.rays_glossy) / s.time_total)) + " ",
                  megabytes(s.memory_peak_bytes));
  }
}

// Whether the part to be rendered is there, whole.
bool is_done(const RenderArguments& arguments, const Scene& scene, const RenderOptions& options) {
  if (!arguments.skip_done) return false;
  const RenderCallbacks none;
  return holds_part(arguments.outputs[0], part_of(Picture(scene, options, none)));
}

int run_render(const RenderArguments& arguments, const std::string& command) {
  const Clock::time_point start = Clock::now();
  require_slice_alone(arguments);
  require_estimator_of_chart(arguments.options);
  if (arguments.denoise) require_denoiser();
  watched_files(arguments);
  require_outputs_writable(arguments);
  require_distinct_files(outputs_of(arguments), {{arguments.scene.path}});
  require_resumed_survives(arguments);
  const std::atomic<bool>& stop = stop_on_interrupt();
  ProgressLine progress(!arguments.quiet);
  progress.update(0.0, "loading");
  const Scene scene = load_scene(arguments.scene, progress);
  require_distinct_files(outputs_of(arguments), scene.files);
  const double load_seconds = seconds_since(start);

  RenderOptions options = arguments.options;
  if (!arguments.crop.empty()) options.crop = parse_crop(arguments.crop, scene.film.crop, "film");
  const Rect& window = options.crop ? *options.crop : scene.film.crop;
  for (const std::string& path : arguments.outputs) require_image_size(path, window.width, window.height);
  if (arguments.denoise) options.aovs.insert(options.aovs.end(), denoise_layers().begin(), denoise_layers().end());
  if (is_done(arguments, scene, options)) {
    progress.clear();
    if (!arguments.quiet)
      print_message("{}: slice {} is there already\n", arguments.outputs[0], slice_text(*options.slice));
    return k_exit_success;
  }
  RenderCallbacks callbacks;
  std::mutex terminal;  // previews warn from threads of their own
  callbacks.progress = [&](float share, const char* stage) {
    const std::lock_guard lock(terminal);
    progress.update(share, stage);
  };
  callbacks.warning = [&, print = print_warnings(progress)](const std::string& message) {
    const std::lock_guard lock(terminal);
    print(message);
  };
  callbacks.stop = &stop;
  // The limit is the whole command's; what is left to do after the picture takes about as long as at other times.
  if (options.time_limit > 0.0f) options.time_limit = std::max(options.time_limit - float(seconds_since(start)), 1e-3f);
  Previews previews;
  open_previews(arguments, crop_window(scene.film, options.crop), callbacks, previews);
  RenderResult result = render(scene, options, callbacks);
  previews.watcher.reset();
  // What is there from before is better than black.
  if (result.interrupted && (result.part || !result.has_samples)) {
    if (previews.viewer) previews.viewer->finish();
    progress.clear();
    print_message("fieldtrace: interrupted; {} was not written\n", result.part ? "the part" : "the picture");
    return k_exit_interrupted;
  }
  if (!result.has_samples && options.time_limit > 0.0f)
    throw Error("the time was up before anything was traced, and " + arguments.outputs[0] +
                " was not written; give --time-limit more");
  std::string denoiser;
  if (arguments.denoise) {
    callbacks.progress(1.0f, "denoise");
    denoiser = denoise_result(arguments, scene, result, callbacks.warning);
    if (previews.viewer) show_result(result.image, *previews.picture);
  }

  Stats& stats = result.stats;
  const Clock::time_point write_begin = Clock::now();
  Writes writes;
  write_outputs(arguments, result, command, denoiser, writes);
  stats.time_write = seconds_since(write_begin);
  if (previews.viewer) previews.viewer->finish();
  progress.clear();
  stats.version = FIELDTRACE_VERSION;
  stats.time_load = load_seconds;
  stats.time_limit = arguments.options.time_limit;
  stats.time_total = seconds_since(start);
  stats.memory_peak_bytes = peak_memory_bytes();
  if (!arguments.stats_file.empty()) writes.attempt([&] { write_text_file(arguments.stats_file, stats.to_json()); });
  if (!arguments.quiet) print_summary(stats);
  writes.rethrow();
  if (!result.interrupted) return k_exit_success;
  print_message("fieldtrace: interrupted; the finished tiles were written\n");
  return k_exit_interrupted;
}

}  // namespace

void add_render_command(CommandLine& line) {
  const auto arguments = std::make_shared<RenderArguments>();
  CLI::App& command = *line.app.add_subcommand("render", "Render a scene");
  add_scene_options(command, arguments->scene);
  command.add_option("-o", arguments->outputs, "Image to write, .exr or .png; may be repeated")
      ->required()
      ->type_name("OUT")
      ->allow_extra_args(false);
  add_render_options(command, arguments->options);
  command.add_option("--crop", arguments->crop, "Pixels of the film to render")
      ->check(not_empty())
      ->type_name("X,Y,W,H");
  command.add_option("--stats", arguments->stats_file, "Write the statistics as JSON")
      ->check(not_empty())
      ->type_name("FILE.json");
  add_exposure_option(command, arguments->exposure);
  command
      .add_option_function<std::string>(
          "--tev", [arguments](const std::string& text) { arguments->viewer = parse_viewer_address(text); },
          "Show the picture while it is rendered in the viewer tev, for example at 127.0.0.1:14158")
      ->type_name("HOST:PORT");
  command.add_flag("--watch", arguments->watch, "Write the PNG outputs every few seconds while rendering");
  command.add_flag("--denoise", arguments->denoise, "Remove the noise by Intel Open Image Denoise before writing");
  command.add_flag("--float32", arguments->float32, "Write EXR as 32-bit float instead of 16-bit half");
  CLI::Option* const slice =
      command
          .add_option_function<std::string>(
              "--slice", [arguments](const std::string& text) { arguments->options.slice = parse_slice(text); },
              "Render the K-th of N parts of the picture, for `fieldtrace merge` to join")
          ->type_name("K/N");
  command.add_flag("--skip-done", arguments->skip_done, "Leave a part that is there, and whole, as it is")
      ->needs(slice);
  command.add_flag("--quiet", arguments->quiet, "No progress and no summary");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_render(*arguments, line.text); }; });
}

}  // namespace fieldtrace
