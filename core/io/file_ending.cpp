#include "core/io/file_ending.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

namespace fieldtrace {

std::string file_ending(const std::string& path) {
  std::string ending = std::filesystem::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return ending;
}

}  // namespace fieldtrace
