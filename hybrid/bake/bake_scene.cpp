#include "hybrid/bake/bake_scene.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <type_traits>

#include "core/io/atomic_file.h"
#include "core/io/input_file.h"
#include "core/io/scratch_folder.h"
#include "core/loader/scene_recentre.h"
#include "core/platform/threads.h"
#include "core/trace/accel.h"
#include "field/bake/bake_full.h"
#include "field/file/field_cache.h"
#include "field/file/field_file.h"
#include "field/grid/vdb_grid.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

// Saves fields one after another into a cache or into numbered files; see the header.
class Output {
 public:
  Output(const std::string& path, uint64_t cache_limit, const WarningSink& warning) : path_(path) {
    vdb();  // throws if nothing can be written for want of it
    if (is_folder(path)) {
      FieldCache::require_writable_folder(path);
      cache_ = std::make_unique<FieldCache>(path, cache_limit, warning);
    } else {
      require_writable(path);
    }
  }

  template <class AnyField>
  void save(const AnyField& field, const FieldIdentity& identity, const std::string& object, BakeResult& result) {
    constexpr bool by_thesis = std::is_same_v<AnyField, ThesisField>;
    const std::string path = cache_ ? cache_->path_of(identity) : numbered_path(path_, result.fields.size());
    if (cache_) {
      cache_->store(field, identity);
    } else if constexpr (by_thesis) {
      save_thesis_field(field, identity, path);
    } else {
      save_field(field, identity, path);
    }
    if constexpr (by_thesis) {
      result.fields.push_back({object, path, thesis_file_info(path)});
    } else {
      result.fields.push_back({object, path, field_info(path)});
    }
  }

  // To be called when all fields are saved.
  void finish() {
    if (cache_) cache_->trim();
  }

  const std::string& path() const { return path_; }
  // That the fields are written to.
  std::string folder() const { return cache_ ? path_ : fs::absolute(path_).parent_path().string(); }

 private:
  std::string path_;
  std::unique_ptr<FieldCache> cache_;
};

std::vector<uint32_t> shapes_to_bake(const Scene& scene, bool full) {
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  std::vector<uint32_t> shapes;
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    const bool only_one = full && scene.shapes.size() == 1;
    if (traits[s].wants_field || only_one) shapes.push_back(s);
  }
  if (shapes.empty()) {
    throw Error("no object of the scene gets a field: all are flat, have fewer than " +
                std::to_string(k_fewest_field_triangles) +
                " triangles, or consist of parts much smaller than the whole, and are left to exact rays");
  }
  return shapes;
}

void bake_fully(const Scene& scene, const std::vector<uint32_t>& shapes, const BakeOptions& options,
                const RenderCallbacks& callbacks, Output& output, BakeResult& result) {
  const Accel accel(scene);
  for (size_t i = 0; i < shapes.size() && !result.interrupted; ++i) {
    const Shape& shape = scene.shapes[shapes[i]];
    FieldBudget budget(options.field_memory ? options.field_memory : default_field_memory());
    Field field(field_ball(shape.bounds), options.fields, &budget, reservable_bytes());
    FullBakeCallbacks full;
    full.stop = callbacks.stop;
    if (callbacks.progress) {
      full.progress = [&](double share) {
        callbacks.progress(float((double(i) + share) / double(shapes.size())), "bake");
      };
    }
    BakeCounters counters;
    const FullBakeResult baked = bake_full(field, accel, shapes[i], counters, full);
    result.interrupted = baked.stopped;
    if (baked.tiles_left_out > 0) {
      warn(callbacks.warning, {},
           shape.name + ": its memory has no room for the last " + std::to_string(baked.tiles_left_out) + " of " +
               std::to_string(field.coverage().slot_count()) +
               " coverage tiles; they will be baked when a render demands them (or raise --field-memory)");
    }
    // A field of which nothing is baked replaces no file.
    if (field.cells_baked() + field.coverage().tiles_baked() > 0)
      output.save(field, field_identity(shape, options.fields), shape.name, result);
  }
}

void bake_by_thesis(const Scene& scene, const std::vector<uint32_t>& shapes, const BakeOptions& options,
                    const RenderCallbacks& callbacks, Output& output, BakeResult& result) {
  const int m = options.thesis_directions;
  require_thesis_memory(1, m, options.field_memory ? options.field_memory : default_field_memory());
  const Accel accel(scene);
  for (size_t i = 0; i < shapes.size() && !result.interrupted; ++i) {
    const Shape& shape = scene.shapes[shapes[i]];
    if (shape.kind != ShapeKind::mesh) throw Error(shape.name + ": the chart thesis is for meshes only");
    ThesisBakeCallbacks bake;
    bake.stop = callbacks.stop;
    if (callbacks.progress) {
      bake.progress = [&](float share) { callbacks.progress((float(i) + share) / float(shapes.size()), "bake"); };
    }
    const auto field = bake_thesis_field(accel, scene, shapes[i], m, bake, ThesisLayers::distance);
    result.interrupted = !field;
    if (field) output.save(*field, thesis_identity(shape, m), shape.name, result);
  }
}

// Bakes what renders demand into files in `scratch`. Returns the fields' parameters.
FieldParameters bake_by_renders(const Scene& scene, const ScratchFolder& scratch, const BakeOptions& options,
                                const RenderCallbacks& callbacks, BakeResult& result) {
  RenderOptions render_options;
  render_options.method = Method::hybrid;
  render_options.spp = 1;
  render_options.leave_to_rays = false;  // other lights or more samples may make a field pay that does not pay here
  render_options.directions = options.fields.directions;
  render_options.plane = options.fields.plane;
  render_options.threads = options.threads;
  render_options.field_cache = scratch.path();
  render_options.if_unkept = IfUnkept::fail;
  render_options.field_memory = options.field_memory;
  // Single rays demand slices; with more samples, whole lights come first and demand coverage tiles.
  RenderResult rendered;
  for (const int light_samples : {1, k_fewest_cone_samples}) {
    render_options.light_samples = light_samples;
    rendered = render(scene, render_options, callbacks);
    result.interrupted = rendered.interrupted;
    if (result.interrupted) break;
  }
  FieldParameters fields = options.fields;
  if (rendered.stats.field_objects > 0) {
    fields.directions = rendered.stats.field_directions;
    fields.plane = rendered.stats.field_plane;
  }
  return fields;
}

void bake_demand(const Scene& scene, const std::vector<uint32_t>& shapes, const BakeOptions& options,
                 const RenderCallbacks& callbacks, Output& output, BakeResult& result) {
  const ScratchFolder scratch(output.folder(), ".fieldtrace-bake-");
  FieldParameters fields;
  try {
    fields = bake_by_renders(scene, scratch, options, callbacks, result);
  } catch (const Error& e) {
    // Names the output in place of a file beside it that is gone by now.
    const std::string message = e.what(), folder = scratch.path() + "/";
    const size_t colon = message.find(": ", folder.size());
    if (message.rfind(folder, 0) != 0 || colon == std::string::npos) throw;
    throw Error({output.path()}, message.substr(colon + 2));
  }
  for (const uint32_t s : shapes) {
    const Shape& shape = scene.shapes[s];
    const FieldIdentity identity = field_identity(shape, fields);
    const std::string path = scratch.path() + "/" + identity.file_name();
    if (!fs::exists(path)) continue;  // nothing of this object was demanded
    Field field(field_ball(shape.bounds), fields, nullptr, reservable_bytes());
    load_field(field, identity, path);
    if (field.pool_full() || field.coverage().full()) {
      throw Error("the field of " + shape.name +
                  " takes more address space than may be reserved; raise the limit (ulimit -v)");
    }
    output.save(field, identity, shape.name, result);
  }
}

}  // namespace

std::string numbered_path(const std::string& path, size_t index) {
  if (index == 0) return path;
  fs::path numbered(path);
  const std::string ending = numbered.extension().string();
  numbered.replace_extension();
  return numbered.string() + "." + std::to_string(index + 1) + ending;
}

Scene scene_of_mesh(TriangleMesh mesh, const std::string& name) {
  Scene scene;
  scene.textures.emplace_back();
  scene.bsdfs.emplace_back();
  Shape& shape = scene.shapes.emplace_back();
  shape.name = name;
  shape.mesh = std::move(mesh);
  shape.bounds = shape.mesh.bounds();
  scene.instances.emplace_back();
  scene.film.crop = {0, 0, scene.film.width, scene.film.height};
  // As scenes of it are loaded, whose renders look for the field by the mesh's vertices.
  ScenePlacement placement;
  placement.instances.emplace_back(1.0);
  recentre_meshes(scene, placement);
  place_scene(scene, placement);
  return scene;
}

BakeResult bake_scene(const Scene& scene, const std::string& path, const BakeOptions& options,
                      const RenderCallbacks& callbacks) {
  const bool by_thesis = options.chart == Chart::thesis;
  const std::vector<uint32_t> shapes = shapes_to_bake(scene, options.full || by_thesis);
  Output output(path, options.cache_limit, callbacks.warning);
  BakeResult result;
  const int threads = threads_or_all(options.threads);
  tbb::task_arena arena(threads);
  const auto bake = by_thesis ? bake_by_thesis : options.full ? bake_fully : bake_demand;
  arena.execute([&] { bake(scene, shapes, options, callbacks, output, result); });
  output.finish();
  return result;
}

}  // namespace fieldtrace
