// What may be read as an input file: regular files only. Devices, pipes and sockets may block or never end.
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>

namespace fieldtrace {

// Whether `path` exists and is neither a regular file nor a folder. Links are followed.
bool is_special_file(const std::string& path);
// Whether the path is one of a folder, as far as this program may see.
bool is_folder(const std::string& path);

// Size in bytes of the file at `path`. Throws Error naming it unless it is a regular file, or if it is larger than the
// machine's memory, since callers read all of it.
uint64_t require_regular_file(const std::string& path);

// The message for special files; it follows the file's name.
inline constexpr const char* k_special_file_message =
    "is not a regular file but a device, a pipe or the like; copy its contents to a file and name that";

}  // namespace fieldtrace
