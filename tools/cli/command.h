// The commands of the program: each registers its options and sets the action to run.
//
// Thread-safety: none needed, the command line is read by the main thread.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "core/platform/error.h"

namespace fieldtrace {

inline constexpr int k_exit_success = 0;
inline constexpr int k_exit_input = 1;          // bad input, or `compare` above its limit
inline constexpr int k_exit_usage = 2;          // wrong options, or an unsupported feature
inline constexpr int k_exit_interrupted = 130;  // SIGINT or SIGTERM

struct CommandLine {
  CLI::App app;
  std::string text;             // as typed, for the metadata of images
  std::function<int()> action;  // set by the command that was chosen; returns the exit code
};

// Each adds one command to `line.app`. Their actions throw Error and UsageError.
void add_render_command(CommandLine& line);
void add_merge_command(CommandLine& line);
void add_bake_command(CommandLine& line);
void add_mesh_command(CommandLine& line);
void add_info_command(CommandLine& line);
void add_compare_command(CommandLine& line);
void add_tradeoff_command(CommandLine& line);
void add_thesis_command(CommandLine& line);

}  // namespace fieldtrace
