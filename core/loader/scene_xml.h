// Reads scenes in a subset of Mitsuba 3's XML format (listed in docs/scenes.md), so that one file can be rendered by
// both.
//
// Source: Mitsuba 3 documentation, "Scene XML file format" and the plugin reference; deviations are in docs/scenes.md.
// Thread-safety: load_scene() may be called from several threads; `warning` is called from the calling thread only.
#pragma once

#include <map>
#include <string>

#include "core/platform/error.h"
#include "core/scene/scene.h"

namespace fieldtrace {

struct SceneLoadOptions {
  // Values for `$name`; they override the file's <default> elements. Unused ones give a warning.
  std::map<std::string, std::string> parameters;
  // Unknown elements, properties, plugins and unused parameters are an Error instead of a warning.
  bool strict = false;
  WarningSink warning;
};

// Loads the scene at `path` with everything it refers to: included files, meshes and bitmaps, searched for beside the
// file that names them and in the folders of <path> elements. World space is re-centred (see scene_recentre.h). Throws
// Error "FILE:LINE: ..." for anything missing, malformed, out of range or not supported yet.
Scene load_scene(const std::string& path, const SceneLoadOptions& options = {});

}  // namespace fieldtrace
