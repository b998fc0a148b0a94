// Standard output, checked like any other output: a failed write is an error.
//
// Thread-safety: main thread only.
#pragma once

#include <string>

namespace fieldtrace {

// Call before anything is opened or printed. Standard streams closed by the caller are replaced with descriptors that
// can be neither read nor written; otherwise the next opened file would get their number and receive printed text. A
// write beyond the file size limit becomes an error instead of a signal that would end the program and leave its
// temporary files behind.
void prepare_streams();

// Flushes what was printed so far. Returns the reason of this or an earlier failure; empty on success.
std::string flush_standard_output();

// The error message for a reason.
std::string standard_output_message(const std::string& reason);

}  // namespace fieldtrace
