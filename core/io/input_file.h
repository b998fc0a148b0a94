// What may be read as an input file: regular files. Devices, pipes and sockets may never end, or never begin.
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>

namespace fieldtrace {

// Whether `path` exists and is something that is neither a regular file nor a folder, links followed.
bool is_special_file(const std::string& path);

// Size in bytes of the file at `path`. Throws Error naming it unless it is a regular file, and if it is larger than the
// machine's memory: whoever asks reads all of it.
uint64_t require_regular_file(const std::string& path);

// What to say of a special file, behind its name.
inline constexpr const char* k_special_file_message =
    "is not a regular file but a device, a pipe or the like; copy its contents to a file and name that";

}  // namespace fieldtrace
