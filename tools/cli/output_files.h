// Detects outputs that would overwrite one another or an input of the program.
//
// Files are the same if their resolved paths are equal or if they are one file under several names (hard links). Costs
// one look at each file, however many there are.
// Thread-safety: pure functions; the files may change meanwhile.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace fieldtrace {

// A file that a command will write.
struct OutputFile {
  std::string option;  // that sets it: "-o", "--stats"
  std::string path;
};

// Throws UsageError, naming both, if two outputs are the same file, or if an output is the same file as an input.
void require_distinct_files(std::span<const OutputFile> outputs, std::span<const std::string> inputs);

}  // namespace fieldtrace
