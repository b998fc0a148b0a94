// Standard output as an output like any other: what cannot be written is an error.
//
// Thread-safety: for the main thread.
#pragma once

#include <string>

namespace fieldtrace {

// To be called before anything is opened or printed. Standard streams that the caller has closed are held by
// descriptors that can neither be read nor written, lest a file that is opened gets their number and what is printed
// goes into it. And a write beyond the limit of file sizes becomes an error instead of a signal that ends the program
// with its temporary files left behind.
void prepare_streams();

// Writes what was printed so far. Returns why that fails, or has failed; empty: all is written.
std::string flush_standard_output();

// The error for a reason.
std::string standard_output_message(const std::string& reason);

}  // namespace fieldtrace
