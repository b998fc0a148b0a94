// Detects outputs that would overwrite one another or an input of the program; makes their folder; writes several, each
// whatever becomes of the others.
//
// Files are the same if their resolved paths are equal or if they are one file under several names (hard links). Costs
// one look at each file, however many there are.
// Thread-safety: pure functions; the files may change meanwhile.
#pragma once

#include <exception>
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

// A folder to write to, and those it lies in, unless they are there. Throws Error if it cannot be made.
void make_folder(const std::string& folder);

class Writes {
 public:
  template <class Write>
  void attempt(const Write& write) {
    try {
      write();
    } catch (const std::exception& e) {
      if (!first_) first_ = std::current_exception();
      messages_.push_back(e.what());
    }
  }
  // What a failure threw; of several, an Error with the messages of all.
  void rethrow() const;

 private:
  std::exception_ptr first_;
  std::vector<std::string> messages_;
};

}  // namespace fieldtrace
