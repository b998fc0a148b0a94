// `fieldtrace thesis`: the tables of the thesis' section 4 beside this program's.
#include "tools/command.h"

namespace fieldtrace {

void add_thesis_command(CommandLine& line) {
  CLI::App& command = *line.app.add_subcommand("thesis", "Reproduce the thesis' tables (not available yet)");
  command.add_option("-o", "Folder to write")->required()->type_name("DIR");
  command.callback([&line] { line.action = []() -> int { throw not_available_yet("the thesis command"); }; });
}

}  // namespace fieldtrace
