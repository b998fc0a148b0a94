// Baking ahead of rendering: fields of a mesh, or of a scene's objects, into files.
//
// A full bake traces every reachable slice and every coverage tile (field/bake/bake_full.h), one object after another;
// what the memory for fields has no room for is reported. Otherwise the scene is rendered at one sample a pixel, the
// picture is discarded, and what its shadow rays demanded is kept; where that exceeds its memory, the fields kept are
// the coarser ones of the render's last attempt (hybrid/fields/field_set.h).
//
// Where fields go. A path that is a folder is a field cache: each field is merged into the file that `--field-cache`
// would use. Any other path is one file for each object: PATH itself for the first, then PATH with .2, .3, ... before
// its extension, in the order of the scene's shapes.
// Thread-safety: functions may be called from several threads with different paths.
#pragma once

#include <functional>
#include <string>
#include <variant>
#include <vector>

#include "core/scene/scene.h"
#include "field/file/field_info.h"
#include "field/file/thesis_file.h"
#include "hybrid/render/render.h"

namespace fieldtrace {

struct BakeOptions {
  Chart chart = Chart::orthographic;
  bool full = false;          // every cell, not only those that the scene demands
  FieldParameters fields;     // D, N, K
  int thesis_directions = 0;  // M of the thesis' chart, instead of `fields`
  int threads = 0;            // 0: all hardware threads
  uint64_t field_memory = 0;  // bytes of fields in memory at once; 0: half of the machine's memory
  uint64_t cache_limit = 0;   // bytes of field files in the output folder; 0: no limit
};

struct BakedField {
  std::string object;  // the shape's name
  std::string path;
  std::variant<FieldFileInfo, ThesisFileInfo> info;
};

struct BakeResult {
  std::vector<BakedField> fields;  // empty if the scene demands none
  bool interrupted = false;        // the fields hold what was finished until then
};

// Bakes every object of `scene` that gets a field in a render (ShapeTraits::wants_field); with `full`, also one that is
// too simple for that if it is the scene's only one. An interrupted bake in the thesis' chart omits the object being
// baked. Callbacks as for render(). Throws Error if no object can have a field or a file cannot be written; the outputs
// are checked before the work starts.
BakeResult bake_scene(const Scene& scene, const std::string& path, const BakeOptions& options,
                      const RenderCallbacks& callbacks = {});

// A scene of one object, for baking a mesh alone. `name` becomes the shape's.
Scene scene_of_mesh(TriangleMesh mesh, const std::string& name);

// The file of object `index`, counted from 0, for an output `path` that is not a folder.
std::string numbered_path(const std::string& path, size_t index);

}  // namespace fieldtrace
