// Entry point: reads the command line, runs one command, turns errors into messages and exit codes.
#include <cstdio>
#include <exception>
#include <new>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "tools/cli/command.h"
#include "tools/cli/standard_output.h"

namespace {

using namespace fieldtrace;

// The chosen command with its subcommand, as typed to get help.
std::string help_hint(const CLI::App& app) {
  std::string name = "fieldtrace";
  for (const CLI::App* at = &app; !at->get_subcommands().empty();) {
    at = at->get_subcommands().front();
    name += " " + at->get_name();
  }
  return "(see `" + name + " --help`)";
}

// For a mistyped command CLI11 only reports that one is required; this names the wrong word.
std::string complaint(const CLI::App& app, const CLI::ParseError& error) {
  const CLI::App* at = &app;
  while (!at->get_subcommands().empty()) at = at->get_subcommands().front();
  const bool lacks_command = !at->get_subcommands([](const CLI::App*) { return true; }).empty();
  const std::vector<std::string> unread = app.remaining(true);
  if (lacks_command && !unread.empty()) return "'" + unread.front() + "' is not one of the commands";
  return error.what();
}

int report(int code, const std::string& message) {
  print_message("fieldtrace: {}\n", message);
  return code;
}

std::string as_typed(int argc, char** argv) {
  std::string text = "fieldtrace";
  for (int i = 1; i < argc; ++i) text += std::string(" ") + argv[i];
  return text;
}

int run(int argc, char** argv) {
  CommandLine line;
  line.text = as_typed(argc, argv);
  CLI::App& app = line.app;
  app.name("fieldtrace");
  app.description("Offline hybrid ray tracer: secondary rays from displacement fields, Monte Carlo to compare with.");
  app.set_version_flag("--version", "fieldtrace " FIELDTRACE_VERSION);
  app.require_subcommand(1);
  add_render_command(line);
  add_merge_command(line);
  add_bake_command(line);
  add_mesh_command(line);
  add_info_command(line);
  add_compare_command(line);
  add_tradeoff_command(line);
  add_thesis_command(line);
  try {
    app.parse(argc, argv);
    return line.action();
  } catch (const CLI::Success& help_or_version) {
    std::ostringstream text;
    const int code = app.exit(help_or_version, text, text);
    std::fputs(text.str().c_str(), stdout);
    return code;
  } catch (const CLI::ParseError& e) {
    return report(k_exit_usage, complaint(app, e) + " " + help_hint(app));
  } catch (const UsageError& e) {
    return report(k_exit_usage, std::string(e.what()) + " " + help_hint(app));
  }
}

int run_and_report(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    return report(k_exit_input, "out of memory; use a smaller image, coarser fields or fewer triangles");
  } catch (const std::system_error& e) {
    if (std::ferror(stdout)) return report(k_exit_input, standard_output_message(e.code().message()));
    return report(k_exit_input, e.what());
  } catch (const std::exception& e) {
    return report(k_exit_input, e.what());
  }
}

}  // namespace

int main(int argc, char** argv) {
  prepare_streams();
  const int code = run_and_report(argc, argv);
  const std::string failure = flush_standard_output();
  if (code != k_exit_success || failure.empty()) return code;
  return report(k_exit_input, standard_output_message(failure));
}
