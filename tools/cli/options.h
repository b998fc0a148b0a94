// Options shared by several commands, and their range checks.
//
// All checks happen while the command line is parsed; a value out of range is a usage error (exit code 2) that names
// the option, the value and the range. Thread-safety: none needed.
#pragma once

#include <CLI/CLI.hpp>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/render/render.h"

namespace fieldtrace {

class ProgressLine;

// A number in [least, most]; NaN and trailing characters are refused.
CLI::Validator number_between(double least, double most);

// A number that is greater than 0 in single precision, and at most `most`: "inf" by default.
CLI::Validator positive_number(double most = std::numeric_limits<double>::infinity());

// No empty text: what a variable gives that is not set.
CLI::Validator not_empty();

// A whole number in [least, most]. To be given to transform(): CLI11 would read 010 as octal, this makes it 10.
CLI::Validator whole_number_between(int64_t least, int64_t most);

// D in {32, 64, 128, 256} and N in {64, 128, 256, 512}: few values, so that caches can be reused.
CLI::Validator field_directions();
CLI::Validator field_plane();

// --threads: 0 (all) to 4096.
void add_threads_option(CLI::App& command, int& threads);

// --chart.
void add_chart_option(CLI::App& command, Chart& chart);

// --field-memory and --field-cache-limit, given in units of 10^6 bytes; the targets are in bytes.
void add_memory_option(CLI::App& command, uint64_t& bytes);
CLI::Option* add_cache_limit_option(CLI::App& command, uint64_t& bytes);

// A scene's path and how to read it.
struct SceneArguments {
  std::string path;
  std::vector<std::string> definitions;  // "name=value"
  bool strict = false;
};
void add_scene_options(CLI::App& command, SceneArguments& arguments);

// Only -D name=value and --strict, for commands whose positional argument need not be a scene.
void add_scene_reading_options(CLI::App& command, SceneArguments& arguments);
// Where it is none: throws UsageError if either was given.
void refuse_scene_reading_options(const SceneArguments& arguments);

// Loads the scene. Warnings go to stderr without disturbing the progress line. Throws Error, and UsageError for a
// malformed -D.
Scene load_scene(const SceneArguments& arguments, ProgressLine& progress);

// Prints "fieldtrace: warning: ..." to stderr without disturbing the progress line, which must outlive the sink.
WarningSink print_warnings(ProgressLine& progress);

// Options of RenderOptions as spelled in the render command; --device is parsed and checked too.
void add_render_options(CLI::App& command, RenderOptions& options);

// The exposure of PNG outputs, in stops.
void add_exposure_option(CLI::App& command, float& exposure);

// "x,y,w,h". Throws UsageError unless these are four whole numbers within `whole`, the pixels of what `name` denotes
// ("film").
Rect parse_crop(const std::string& text, const Rect& whole, const std::string& name);

// Peak resident memory of the process so far, in bytes.
uint64_t peak_memory_bytes();

}  // namespace fieldtrace
