// The checksum behind a field file: 32 bytes that detect any change to the bytes before them.
//
// Memory layout: 7 bytes "FTFIELD" and one of the format version (1 in all formats up to 7); the number of bytes before
// the trailer; two words of their hash. Words are little-endian. Thread-safety: pure functions on distinct files.
#pragma once

#include <optional>
#include <string>

namespace fieldtrace {

// Appends the trailer to a complete file. Throws Error naming `name` if it cannot be read or written.
void append_trailer(const std::string& path, const std::string& name);

// The contents of a file without its trailer. Throws MissingFieldFile if there is none, FieldFileError if it cannot be
// read or the trailer is missing, of another format version, or does not fit.
std::string read_checked(const std::string& path);

// The version byte of a file that ends in a trailer for its size; the rest is not read. Nothing for other files.
std::optional<int> trailer_version(const std::string& path);

// Why a file of another format version is refused, in the words of FieldFileError::reason(). Unchecked: `version` is
// not k_field_format_version.
std::string other_format(int version);

}  // namespace fieldtrace
