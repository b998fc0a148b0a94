// Folders for temporary files, removed with their contents by the destructor.
//
// Thread-safety: distinct objects are independent, also those of several processes that share a parent folder.
#pragma once

#include <string>

namespace fieldtrace {

class ScratchFolder {
 public:
  // Makes a folder in `parent`, which must exist, that no other object uses. Its name begins with `prefix` and ends in
  // ".tmp". Throws Error naming `parent` if it cannot be made.
  ScratchFolder(const std::string& parent, const std::string& prefix);
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace fieldtrace
