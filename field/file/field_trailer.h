// The checksum behind a field file: 32 bytes that detect any change to the bytes before them.
//
// Memory layout: 8 bytes "FTFIELD" and 1; the number of bytes before the trailer; two words of their hash. Words are
// little-endian. Thread-safety: pure functions on distinct files.
#pragma once

#include <string>

namespace fieldtrace {

// Appends the trailer to a complete file. Throws Error naming `name` if it cannot be read or written.
void append_trailer(const std::string& path, const std::string& name);

// The contents of a file without its trailer. Throws FieldFileError if the file cannot be read, or the trailer is
// missing or does not match.
std::string read_checked(const std::string& path);

// Whether `path` ends with a trailer that matches the file's size; the rest is not read.
bool has_trailer(const std::string& path);

}  // namespace fieldtrace
