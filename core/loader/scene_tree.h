// A scene file as a tree of elements: includes expanded, `$name` replaced, every element with its source location. The
// builders (scene_*.cpp) read only this tree and never see the XML library.
//
// Source: Mitsuba 3 documentation, "Scene XML file format". Thread-safety: const after load_scene_tree().
// Memory layout: a tree of values; `SceneTree::ids` points into it, so a SceneTree cannot be copied or moved.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/platform/error.h"

namespace fieldtrace {

// Where the builders send their messages.
struct Diagnostics {
  bool strict = false;
  WarningSink sink;

  // For notices where the image is still the one that the file describes.
  void warning(const SourceLocation& where, const std::string& message) const { warn(sink, where, message); }
  // For content of the file that is rendered differently than it says: a warning, an Error in strict mode.
  void unknown(const SourceLocation& where, const std::string& message) const {
    if (strict) throw Error(where, message + " (an error because of strict mode)");
    warn(sink, where, message);
  }
};

// Folders searched for relative file names, first to last. Shared by all elements of one file.
using SearchFolders = std::vector<std::filesystem::path>;

struct SceneNode {
  std::string tag;             // "shape", "float", "translate", ...
  std::string type, id, name;  // attributes of those names, empty where absent
  std::vector<std::pair<std::string, std::string>> attributes;
  std::vector<SceneNode> children;
  SourceLocation where;
  std::shared_ptr<const SearchFolders> folders;

  // The attribute's value, or null if it is absent.
  const std::string* attribute(const std::string& key) const;
  // The attribute's value. Throws Error if it is absent.
  const std::string& required(const std::string& key) const;
};

struct SceneTree {
  SceneNode root;
  std::map<std::string, const SceneNode*> ids;
  std::vector<std::string> files;  // the scene file and its includes, once per inclusion

  SceneTree() = default;
  SceneTree(const SceneTree&) = delete;
  SceneTree& operator=(const SceneTree&) = delete;
};

// Fills `tree` from the file at `path`. Throws Error for files that cannot be read, XML that is not well-formed,
// undefined parameters, include cycles and ids given twice.
void load_scene_tree(const std::string& path, const std::map<std::string, std::string>& parameters,
                     const Diagnostics& diagnostics, SceneTree& tree);

// The existing file or folder that `name` refers to in the file of `node`. Throws Error if there is none.
std::string resolve_file(const SceneNode& node, const std::string& name);

}  // namespace fieldtrace
