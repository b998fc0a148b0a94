// Outputs that would overwrite one another, or what the program reads.
//
// Files are the same if their paths are, links resolved, or if they are one file under several names. Thread-safety:
// pure functions; the files may change meanwhile.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace fieldtrace {

// A file that a command will write.
struct OutputFile {
  std::string option;  // that names it: "-o", "--stats"
  std::string path;
};

// Throws UsageError, naming both, if two of the outputs are the same file, or one is the same as one of `inputs`.
void require_distinct_files(std::span<const OutputFile> outputs, std::span<const std::string> inputs);

}  // namespace fieldtrace
