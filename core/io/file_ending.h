// The ending of a file's name.
#pragma once

#include <string>

namespace fieldtrace {

// With its dot, in lower case: ".exr" of "a/B.EXR"; empty if there is none.
std::string file_ending(const std::string& path);

}  // namespace fieldtrace
