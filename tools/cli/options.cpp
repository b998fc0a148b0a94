#include "tools/cli/options.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <charconv>
#include <cmath>
#include <optional>

#include "core/loader/scene_xml.h"
#include "hybrid/path/aovs.h"
#include "hybrid/visibility/visibility_device.h"
#include "tools/cli/command.h"
#include "tools/cli/progress.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

// Keeps products with the pixels of a large film far below 2^63.
constexpr int k_max_samples = 1 << 20;
constexpr int k_max_threads = 4096;
// Stops beyond which every finite float becomes 0 or infinite.
constexpr double k_max_exposure = 126.0;
// Of errors, and of seconds: 30 years.
constexpr double k_most_limit = 1e9;
// 10^18 bytes.
constexpr int64_t k_max_megabytes = int64_t(1000) * 1000 * 1000 * 1000;

template <class T>
std::optional<T> whole_parse(const std::string& text) {
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

CLI::Validator one_of(std::vector<std::string> values) {
  const std::string list = fmt::format("{}", fmt::join(values, ", "));
  return CLI::Validator(
      [values, list](std::string& text) {
        for (const std::string& value : values) {
          if (text == value) return std::string();
        }
        return fmt::format("'{}' is not one of {}", text, list);
      },
      "{" + list + "}");
}

// An option that takes the names of values, listed in this order.
template <class T>
void add_choice(CLI::App& command, const char* name, T& target, const std::vector<std::pair<std::string, T>>& choices,
                const char* type, const char* help) {
  std::vector<std::string> names;
  for (const auto& [choice, value] : choices) names.push_back(choice);
  command
      .add_option_function<std::string>(
          name,
          [&target, choices](const std::string& text) {
            for (const auto& [choice, value] : choices)
              if (text == choice) target = value;
          },
          help)
      ->check(one_of(names))
      ->type_name(type);
}

}  // namespace

CLI::Validator number_between(double least, double most) {
  return CLI::Validator(
      [=](std::string& text) {
        const auto value = whole_parse<double>(text);
        // Written so that NaN, which fails every comparison, is refused.
        if (value && *value >= least && *value <= most) return std::string();
        return fmt::format("'{}' is not a number between {} and {}", text, least, most);
      },
      fmt::format("in [{}, {}]", least, most));
}

CLI::Validator positive_number(double most) {
  const std::string and_most = std::isfinite(most) ? fmt::format(" and at most {}", most) : std::string();
  return CLI::Validator(
      [=](std::string& text) {
        const auto value = whole_parse<double>(text);
        if (value && float(*value) > 0.0f && *value <= most) return std::string();
        return fmt::format("'{}' is not a number greater than 0{}", text, and_most);
      },
      "> 0");
}

CLI::Validator not_empty() {
  return CLI::Validator(
      [](std::string& text) { return text.empty() ? "it is empty; leave the option out" : std::string(); }, "");
}

CLI::Validator whole_number_between(int64_t least, int64_t most) {
  return CLI::Validator(
      [=](std::string& text) {
        const auto value = whole_parse<int64_t>(text);
        if (value && *value >= least && *value <= most) {
          text = std::to_string(*value);
          return std::string();
        }
        return fmt::format("'{}' is not a whole number between {} and {}", text, least, most);
      },
      fmt::format("in [{}, {}]", least, most));
}

// What --device can name: the CPU, and the devices that have registered themselves.
std::vector<std::string> device_names() {
  std::vector<std::string> names = {"cpu"};
  for (const DeviceKind& kind : device_kinds()) names.push_back(kind.name);
  return names;
}

CLI::Validator field_directions() { return one_of({"32", "64", "128", "256"}); }
CLI::Validator field_plane() { return one_of({"64", "128", "256", "512"}); }

void add_threads_option(CLI::App& command, int& threads) {
  command.add_option("--threads", threads, "Threads (default: 0, all)")
      ->transform(whole_number_between(0, k_max_threads))
      ->type_name("N");
}

void add_chart_option(CLI::App& command, Chart& chart) {
  add_choice(command, "--chart", chart, {{"orthographic", Chart::orthographic}, {"thesis", Chart::thesis}}, "NAME",
             "How rays are cut into cells (default: orthographic); thesis: whole fields of nearest cells, M = "
             "--directions (32, 64, 128; default: 64), no --plane");
}

namespace {

CLI::Option* add_megabytes(CLI::App& command, const char* name, uint64_t& bytes, const char* help) {
  return command
      .add_option_function<uint64_t>(
          name, [&bytes](const uint64_t& megabytes) { bytes = megabytes * 1000000; }, help)
      ->transform(whole_number_between(1, k_max_megabytes))
      ->type_name("MB");
}

}  // namespace

void add_memory_option(CLI::App& command, uint64_t& bytes) {
  add_megabytes(command, "--field-memory", bytes, "Memory that fields may take (default: half of the machine's)");
}

CLI::Option* add_cache_limit_option(CLI::App& command, uint64_t& bytes) {
  return add_megabytes(
      command, "--field-cache-limit", bytes,
      "Size that the folder of fields is kept below by removing the least recently used (default: none)");
}

void add_scene_reading_options(CLI::App& command, SceneArguments& arguments) {
  command.add_option("-D", arguments.definitions, "Value for $name in the scene file; may be repeated")
      ->type_name("name=value")
      ->allow_extra_args(false);
  command.add_flag("--strict", arguments.strict,
                   "Refuse scenes of which something would be left out, cut off or blurred with a warning");
}

void refuse_scene_reading_options(const SceneArguments& arguments) {
  if (arguments.definitions.empty() && !arguments.strict) return;
  const char* const option = arguments.strict ? "--strict" : "-D";
  throw UsageError(fmt::format("{}: only of scenes; {} does not end in .xml", option, arguments.path));
}

void add_scene_options(CLI::App& command, SceneArguments& arguments) {
  command.add_option("scene", arguments.path, "Scene file (Mitsuba 3 XML subset)")->required()->type_name("SCENE.xml");
  add_scene_reading_options(command, arguments);
}

WarningSink print_warnings(ProgressLine& progress) {
  return [&progress](const std::string& message) {
    progress.clear();
    print_message("fieldtrace: warning: {}\n", message);
  };
}

Scene load_scene(const SceneArguments& arguments, ProgressLine& progress) {
  SceneLoadOptions options;
  for (const std::string& definition : arguments.definitions) {
    const size_t equals = definition.find('=');
    if (equals == 0 || equals == std::string::npos) {
      throw UsageError("-D " + definition + ": write -D name=value");
    }
    options.parameters[definition.substr(0, equals)] = definition.substr(equals + 1);
  }
  options.strict = arguments.strict;
  options.warning = print_warnings(progress);
  return load_scene(arguments.path, options);
}

void add_render_options(CLI::App& command, RenderOptions& options) {
  const std::vector<std::string> aovs = aov_names();
  const auto whole = [&](const char* name, auto& target, int64_t least, int64_t most, const char* help) {
    command.add_option(name, target, help)->transform(whole_number_between(least, most))->type_name("N");
  };

  add_choice(command, "--method", options.method, {{"hybrid", Method::hybrid}, {"montecarlo", Method::monte_carlo}},
             "NAME", "How secondary rays are answered (default: hybrid)");
  whole("--spp", options.spp, 1, k_max_samples, "Camera samples a pixel (default: the scene's)");
  whole("--light-samples", options.light_samples, 1, k_most_light_samples,
        "Shadow rays per light and hit (default: 1)");
  add_choice(
      command, "--light-estimator", options.light_estimator,
      {{"samples", LightEstimator::samples}, {"adaptive", LightEstimator::adaptive}}, "NAME",
      "Light samples where something may hide the light: as many as elsewhere, or up to 8 for each camera sample "
      "(default: adaptive for hybrid, samples for montecarlo)");
  whole("--lobe-samples", options.lobe_samples, 1, k_most_lobe_samples, "Rays per glossy hit (default: 1)");
  command.add_option("--seed", options.seed, "Random seed (default: the scene's)")
      ->transform(whole_number_between(0, std::numeric_limits<uint32_t>::max()))
      ->type_name("S");
  command
      .add_option("--tolerance", options.tolerance,
                  "From 0 (every ray exact) to 1 (every cell answers) (default: 0.1, less with many samples, under "
                  "skies more with few)")
      ->check(number_between(0.0, 1.0))
      ->type_name("T");
  command.add_option("--directions", options.directions, "Direction cells D of a field (default: from the scene)")
      ->check(field_directions())
      ->type_name("D");
  command.add_option("--plane", options.plane, "Plane cells N of a field (default: from the scene)")
      ->check(field_plane())
      ->type_name("N");
  add_chart_option(command, options.chart);
  add_choice(command, "--field-hits", options.field_hits,
             {{"auto", FieldHits::automatic}, {"always", FieldHits::always}, {"never", FieldHits::never}}, "WHEN",
             "Whether fields answer glossy rays by certified hits (default: auto, where their bake pays)");
  CLI::Option* const cache =
      command.add_option("--field-cache", options.field_cache, "Folder that keeps fields between renders")
          ->check(not_empty())
          ->type_name("DIR");
  add_cache_limit_option(command, options.field_cache_limit)->needs(cache);
  add_memory_option(command, options.field_memory);
  add_threads_option(command, options.threads);
  add_choice(command, "--isa", options.isa,
             {{"auto", Isa::automatic},
              {"scalar", Isa::scalar},
              {"sse4", Isa::sse4},
              {"avx2", Isa::avx2},
              {"avx512", Isa::avx512}},
             "NAME", "Instruction set of the look-ups (default: auto)");
  command
      .add_option_function<std::string>(
          "--device",
          [&options](const std::string& name) {
            if (name != "cpu") device_kind(name);  // throws where this build lacks it
            options.device = name;
          },
          "Machine that answers shadow rays (default: cpu)")
      ->check(one_of(device_names()))
      ->type_name("NAME");
  add_megabytes(command, "--device-memory", options.device_memory,
                "Memory of the device that fields may take there (default: all)");
  command.add_flag("--check", options.check, "Trace an exact ray beside every certified answer, count the wrong ones");
  command
      .add_option("--aov", options.aovs,
                  fmt::format("Further layers of the EXR, separated by commas: {}", fmt::join(aovs, ", ")))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(one_of(aovs).description({}))  // the help lists them already
      ->type_name("LIST");
  const auto add_positive = [&](const char* name, float& target, const char* type, const char* help) {
    command.add_option(name, target, help)->check(positive_number(k_most_limit))->type_name(type);
  };
  add_positive(
      "--target-error", options.target_error, "E",
      "Root mean square error of the picture at which it is finished; --spp is then the most samples of a pixel");
  command
      .add_option_function<float>(
          "--target-error-relative",
          [&options](const float& error) {
            options.target_error = error;
            options.error_measure = ErrorMeasure::relative;
          },
          "The same, relative: the root of relmse")
      ->check(positive_number(k_most_limit))
      ->type_name("E")
      ->excludes("--target-error");
  CLI::Option* const checkpoint =
      command
          .add_option("--checkpoint", options.checkpoint,
                      "File that keeps what has been rendered: for --resume, after an interrupt or for more samples")
          ->check(not_empty())
          ->type_name("FILE");
  command.add_option("--checkpoint-every", options.checkpoint_seconds, "Seconds between checkpoints (default: 60)")
      ->check(number_between(0.0, k_most_limit))
      ->type_name("S")
      ->needs(checkpoint);
  command.add_option("--resume", options.resume, "Checkpoint to go on from, with the options that it was written with")
      ->check(not_empty())
      ->type_name("FILE");
  add_positive("--time-limit", options.time_limit, "S", "Seconds after which the picture is finished as it is");
  command
      .add_option("--ao-distance", options.ao_distance,
                  "World units beyond which nothing occludes the layer ao (default: inf)")
      ->check(positive_number())
      ->type_name("D");
  whole("--max-depth", options.max_depth, -1, 1 << 16,
        "Longest path, -1 for no limit, 1: emission only, 2: direct light (default: the scene's)");
}

void add_exposure_option(CLI::App& command, float& exposure) {
  command.add_option("--exposure", exposure, "Exposure of a PNG in stops (default: 0)")
      ->check(number_between(-k_max_exposure, k_max_exposure))
      ->type_name("EV");
}

Rect parse_crop(const std::string& text, const Rect& whole, const std::string& name) {
  Rect crop;
  int* const fields[4] = {&crop.x, &crop.y, &crop.width, &crop.height};
  size_t begin = 0;
  for (int i = 0; i < 4; ++i) {
    const size_t end = i < 3 ? text.find(',', begin) : text.size();
    const auto value = end == std::string::npos ? std::nullopt : whole_parse<int>(text.substr(begin, end - begin));
    if (!value) throw UsageError("--crop " + text + ": write four whole numbers X,Y,W,H");
    *fields[i] = *value;
    begin = end + 1;
  }
  if (!is_inside(crop, whole)) {
    throw UsageError(fmt::format("--crop {}: not inside the {}, which covers {},{},{},{}", text, name, whole.x, whole.y,
                                 whole.width, whole.height));
  }
  return crop;
}

uint64_t peak_memory_bytes() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  return uint64_t(usage.ru_maxrss) * 1024;  // Linux counts in units of 1024 bytes
}

}  // namespace fieldtrace
