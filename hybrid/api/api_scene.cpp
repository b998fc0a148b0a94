// Scenes, fields and pictures of the C interface.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "core/image/image.h"
#include "core/io/atomic_file.h"
#include "core/io/file_ending.h"
#include "core/loader/scene_limits.h"
#include "core/loader/scene_xml.h"
#include "core/mesh/mesh_parts.h"
#include "core/platform/parallel.h"
#include "field/bake/bake_full.h"
#include "field/file/field_file.h"
#include "field/file/field_info.h"
#include "field/store/field_budget.h"
#include "hybrid/api/api_buffers.h"
#include "hybrid/api/scene_object.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

using Alone = std::unique_lock<TurnMutex>;
using Shared = std::shared_lock<TurnMutex>;

Affine transform_of(const float* columns) {
  if (!columns) return Affine(1.0f);
  require(reinterpret_cast<uintptr_t>(columns) % alignof(float) == 0, "the transform is not aligned");
  Affine a;
  for (int c = 0; c < 4; ++c) {
    a[c] = Vec3(columns[3 * c], columns[3 * c + 1], columns[3 * c + 2]);
    require(is_finite(a[c]), "the transform has numbers that are not finite");
  }
  const Affine inverse = Affine(inverse_affine(DAffine(a)));
  for (int c = 0; c < 4; ++c) require(is_finite(inverse[c]), "the transform cannot be inverted");
  return a;
}

Vec3 triple(const float* v, const char* name) {
  require(v != nullptr, std::string(name) + " is null");
  require(reinterpret_cast<uintptr_t>(v) % alignof(float) == 0, std::string(name) + " is not aligned");
  const Vec3 value(v[0], v[1], v[2]);
  require(is_finite(value), std::string(name) + " is not finite");
  return value;
}

Rgb colour(const float* rgb, const char* name) {
  const Rgb value = triple(rgb, name);
  require(value.x >= 0.0f && value.y >= 0.0f && value.z >= 0.0f, std::string(name) + " is negative");
  return value;
}

std::string text_of(const char* text, const char* name) {
  require(text != nullptr, std::string(name) + " is null");
  return text;
}

void require_instance(const SceneObject& s, uint32_t instance) {
  require(instance < s.scene.instances.size(), "there is no instance " + std::to_string(instance));
}

void require_open(const SceneObject& s, const char* function) {
  if (s.fields) throw Failure(FT_ERROR_INVALID_OPERATION, std::string(function) + ": only before the first commit");
}

// A material of the instance alone.
uint32_t add_diffuse(Scene& scene, const Rgb& reflectance) {
  Texture texture;
  texture.color0 = reflectance;
  scene.textures.push_back(texture);
  Bsdf bsdf;
  bsdf.reflectance = uint32_t(scene.textures.size() - 1);
  bsdf.two_sided = true;
  scene.bsdfs.push_back(bsdf);
  return uint32_t(scene.bsdfs.size() - 1);
}

int64_t clamped(uint64_t value) {
  return int64_t(std::min<uint64_t>(value, uint64_t(std::numeric_limits<int64_t>::max())));
}

int int_within(const char* name, int64_t value, int64_t least, int64_t most) {
  require(value >= least && value <= most, std::string("\"") + name + "\" must lie within [" + std::to_string(least) +
                                               ", " + std::to_string(most) + "]");
  return int(value);
}

// What a field holds, by name.
using FieldNumber = uint64_t (*)(const Field& field, float tolerance);
const std::map<std::string, FieldNumber>& field_numbers() {
  static const std::map<std::string, FieldNumber> numbers = {
      {"bytes", [](const Field& f, float) { return f.bytes(); }},
      {"cells_baked", [](const Field& f, float) { return f.cells_baked(); }},
      {"cells_certified",
       [](const Field& f, float tolerance) {
         uint64_t cells = 0;
         for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
           const LayerInfo info = layer_info(f, layer, tolerance);
           cells += info.clear + info.blocked;
         }
         return cells;
       }},
      {"cells_full", [](const Field& f, float) { return f.cells_full(); }}};
  return numbers;
}

// Returns whether there was room for all of it.
bool bake_whole(SceneObject& s, uint32_t shape, const FullBakeCallbacks& callbacks) {
  BakeCounters counters;
  try {
    const FullBakeResult baked = bake_full(*s.hit_fields[shape], *s.accel, shape, counters, callbacks);
    // Of the triangles of hits, which are not baked ahead.
    if (!baked.stopped) s.demands[shape]->stop_waiting();
    return baked.stopped || baked.tiles_left_out == 0;
  } catch (const Error&) {
    return false;  // its message names options of the command line
  }
}

void require_no_input(const Scene& scene, const std::string& path) {
  const std::string identity = file_identity(path);
  for (const std::string& input : scene.files) {
    require(file_identity(input) != identity, path + ": would overwrite the scene's file " + input);
  }
}

RenderResult render_scene(SceneObject& s, Progress& progress) {
  check_limits(s.scene);  // the camera may have moved since the commit
  RenderCallbacks callbacks;
  callbacks.progress = [&](float share, const char*) { progress(double(share)); };
  callbacks.stop = progress.stop();
  callbacks.warning = without_repeats(warnings_of(*s.device));
  RenderOptions options = s.options;
  options.tolerance = s.tolerance;
  options.threads = s.device->arena.max_concurrency();
  return render(s.scene, options, callbacks);
}

}  // namespace

FTError ftNewScene(FTDevice device, FTScene* scene) {
  return guarded(device_or_null(device), [&] {
    const std::shared_ptr<Device> d = find(device);
    require_place(scene, "ftNewScene: the scene");
    const auto object = std::make_shared<SceneObject>(d);
    object->scene.film.crop = {0, 0, object->scene.film.width, object->scene.film.height};
    *scene = std::bit_cast<FTScene>(register_object(object));
  });
}

FTError ftLoadScene(FTDevice device, const char* path, FTScene* scene) {
  return guarded(device_or_null(device), [&] {
    const std::shared_ptr<Device> d = find(device);
    require_place(scene, "ftLoadScene: the scene");
    const auto object = std::make_shared<SceneObject>(d);
    SceneLoadOptions options;
    options.warning = without_repeats(warnings_of(*d));
    object->scene = load_scene(text_of(path, "path"), options);
    for (const Instance& i : object->scene.instances) object->transforms.push_back(i.to_world);
    execute_in(d->arena, [&] { object->commit(); });
    *scene = std::bit_cast<FTScene>(register_object(object));
  });
}

FTError ftAddMesh(FTScene scene, const float* positions, size_t position_stride, size_t position_count,
                  const uint32_t* triangles, size_t triangle_stride, size_t triangle_count, uint32_t* mesh) {
  return guarded(scene, [&](SceneObject& s) {
    const Buffer<const float, 3> from("positions", positions, position_stride, position_count);
    const Buffer<const uint32_t, 3> corners("triangles", triangles, triangle_stride, triangle_count);
    from.needed(), corners.needed();
    if (mesh) require_place(mesh, "ftAddMesh: the mesh's number");
    require(position_count > 0 && triangle_count > 0, "ftAddMesh: a mesh has positions and triangles");
    const size_t most = std::numeric_limits<int32_t>::max();
    require(position_count <= most && triangle_count <= most, "ftAddMesh: too many positions or triangles");
    Shape shape;
    shape.mesh.positions.resize(position_count);
    shape.mesh.triangles.resize(triangle_count);
    for (size_t i = 0; i < position_count; ++i) {
      shape.mesh.positions[i] = vector_at(from, i);
      require(is_finite(shape.mesh.positions[i]), "position " + std::to_string(i) + " is not finite");
    }
    for (size_t i = 0; i < triangle_count; ++i) {
      const uint32_t* const t = corners.at(i);
      require(t[0] < position_count && t[1] < position_count && t[2] < position_count,
              "triangle " + std::to_string(i) + " refers to a position that is not there");
      shape.mesh.triangles[i] = UVec3(t[0], t[1], t[2]);
    }
    drop_unused_vertices(shape.mesh);
    shape.bounds = shape.mesh.bounds();
    const Alone lock(s.mutex);
    require_open(s, "ftAddMesh");
    const auto number = uint32_t(s.scene.shapes.size());
    shape.name = "mesh " + std::to_string(number);
    s.scene.shapes.push_back(std::move(shape));
    if (mesh) *mesh = number;
  });
}

FTError ftAddInstance(FTScene scene, uint32_t mesh, const float* transform, uint32_t* instance) {
  return guarded(scene, [&](SceneObject& s) {
    const Affine to_world = transform_of(transform);
    if (instance) require_place(instance, "ftAddInstance: the instance's number");
    const Alone lock(s.mutex);
    require_open(s, "ftAddInstance");
    require(mesh < s.scene.shapes.size(), "there is no mesh " + std::to_string(mesh));
    Instance added;
    added.shape = mesh;
    added.bsdf = s.scene.bsdfs.empty() ? add_diffuse(s.scene, Rgb(0.5f)) : 0;
    s.scene.instances.push_back(added);
    s.transforms.push_back(to_world);
    if (instance) *instance = uint32_t(s.scene.instances.size() - 1);
  });
}

FTError ftSetInstanceTransform(FTScene scene, uint32_t instance, const float* transform) {
  return guarded(scene, [&](SceneObject& s) {
    const Affine to_world = transform_of(transform);
    const Alone lock(s.mutex);
    require_instance(s, instance);
    s.transforms[instance] = to_world;
  });
}

FTError ftSetInstanceReflectance(FTScene scene, uint32_t instance, const float* rgb) {
  return guarded(scene, [&](SceneObject& s) {
    const Rgb value = colour(rgb, "the reflectance");
    require(value.x <= 1.0f && value.y <= 1.0f && value.z <= 1.0f, "the reflectance is more than 1");
    const Alone lock(s.mutex);
    require_instance(s, instance);
    const auto [own, is_new] = s.own_bsdfs.try_emplace(instance, 0);
    if (is_new)
      own->second = add_diffuse(s.scene, value);
    else
      s.scene.textures[s.scene.bsdfs[own->second].reflectance].color0 = value;
    s.scene.instances[instance].bsdf = own->second;
  });
}

FTError ftSetInstanceRadiance(FTScene scene, uint32_t instance, const float* rgb) {
  return guarded(scene, [&](SceneObject& s) {
    const Rgb value = colour(rgb, "the radiance");
    const Alone lock(s.mutex);
    require_instance(s, instance);
    Instance& lamp = s.scene.instances[instance];
    if (lamp.emitter == k_none) {
      Emitter emitter;
      emitter.instance = instance;
      lamp.emitter = uint32_t(s.scene.emitters.size());
      s.scene.emitters.push_back(emitter);
    }
    s.scene.emitters[lamp.emitter].value = value;
  });
}

FTError ftSetSceneSky(FTScene scene, const float* rgb) {
  return guarded(scene, [&](SceneObject& s) {
    const Rgb value = colour(rgb, "the sky");
    const Alone lock(s.mutex);
    Emitter sky;
    sky.kind = EmitterKind::constant;
    sky.value = value;
    // In place of the map of a scene file, too.
    std::vector<Emitter>& all = s.scene.emitters;
    const auto old = std::find_if(all.begin(), all.end(), [](const Emitter& e) { return is_sky(e.kind); });
    if (old == all.end())
      all.push_back(sky);
    else
      *old = sky;
  });
}

FTError ftSetSceneCamera(FTScene scene, const float* from, const float* to, const float* up, float horizontal_degrees,
                         uint32_t width, uint32_t height) {
  return guarded(scene, [&](SceneObject& s) {
    const Vec3 eye = triple(from, "from"), target = triple(to, "to"), above = triple(up, "up");
    require_within(eye, k_largest_coordinate, "the camera");
    const Vec3 side = glm::cross(above, target - eye);
    require(glm::length(side) > 0.0f && is_finite(glm::normalize(side)), "`up` lies along the view, or there is none");
    require(horizontal_degrees > 0.0f && horizontal_degrees < 180.0f, "the angle must lie within (0, 180) degrees");
    constexpr uint32_t k_most_pixels = 1u << 15;
    require(width >= 1 && height >= 1 && width <= k_most_pixels && height <= k_most_pixels,
            "a picture has 1 to 32768 pixels a side");
    const Alone lock(s.mutex);
    const Vec3 z = glm::normalize(target - eye), x = glm::normalize(side);
    Camera pinhole;
    pinhole.to_world = Affine(x, glm::cross(z, x), z, eye);
    pinhole.fov_x_degrees = horizontal_degrees;
    s.scene.camera = pinhole;
    s.fits_clips = true;
    s.fit_clips();
    s.scene.film.width = int(width), s.scene.film.height = int(height);
    s.scene.film.crop = {0, 0, int(width), int(height)};
  });
}

FTError ftSetSceneInt(FTScene scene, const char* name, int64_t value) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string key = text_of(name, "name");
    const Alone lock(s.mutex);
    FieldParameters parameters = s.parameters;
    if (key == "spp") {
      s.options.spp = int_within(name, value, 0, 1 << 20);
    } else if (key == "seed") {
      require(value >= 0 && value <= std::numeric_limits<uint32_t>::max(), "\"seed\" must have 32 bits");
      s.options.seed = uint32_t(value);
    } else if (key == "max_depth") {
      s.options.max_depth = int_within(name, value, -1, 1 << 20);
    } else if (key == "montecarlo") {
      s.options.method = int_within(name, value, 0, 1) ? Method::monte_carlo : Method::hybrid;
    } else if (key == "directions" || key == "plane") {
      require_open(s, "ftSetSceneInt");
      (key == "plane" ? parameters.plane : parameters.directions) = int_within(name, value, 1, 1 << 20);
      require(valid_parameters(parameters), "\"directions\" is one of 32 64 128 256, \"plane\" of 64 128 256 512");
      s.parameters = parameters;
      s.options.directions = parameters.directions, s.options.plane = parameters.plane;
    } else if (key == "field_memory") {
      require_open(s, "ftSetSceneInt");
      require(value >= 0, "\"field_memory\" is negative");
      s.options.field_memory = uint64_t(value);
    } else {
      require(false, "there is no integer \"" + key + "\"");
    }
  });
}

FTError ftSetSceneFloat(FTScene scene, const char* name, double value) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string key = text_of(name, "name");
    require(key == "tolerance", "there is no float \"" + key + "\"");
    require(value >= 0.0 && value <= 1.0, "\"tolerance\" must lie within [0, 1]");
    const Alone lock(s.mutex);
    s.options.tolerance = float(value);
  });
}

FTError ftCommitScene(FTScene scene) {
  return guarded(scene, [&](SceneObject& s) {
    const Alone lock(s.mutex);
    // Scene files may hold a sky alone; ftLoadScene() has committed those.
    if (!s.fields && s.scene.instances.empty())
      throw Failure(FT_ERROR_INVALID_OPERATION, "ftCommitScene: the scene has no instances");
    execute_in(s.device->arena, [&] { s.commit(); });
  });
}

FTError ftGetSceneOrigin(FTScene scene, double* origin) {
  return guarded(scene, [&](SceneObject& s) {
    require_place(origin, "ftGetSceneOrigin: the origin");
    const Shared lock(s.mutex);
    for (int c = 0; c < 3; ++c) origin[c] = s.scene.origin[c];
  });
}

FTError ftBakeFields(FTScene scene) {
  return guarded(scene, [&](SceneObject& s) {
    Progress progress(*s.device);
    const Shared lock(s.mutex);
    s.require_commit("ftBakeFields");
    std::vector<uint32_t> shapes;
    for (uint32_t i = 0; i < s.hit_fields.size(); ++i) {
      if (s.hit_fields[i]) shapes.push_back(i);
    }
    bool all_fit = true;
    execute_in(s.device->arena, [&] {
      for (size_t i = 0; i < shapes.size() && !*progress.stop(); ++i) {
        FullBakeCallbacks callbacks;
        callbacks.stop = progress.stop();
        callbacks.progress = [&](double share) { progress((double(i) + share) / double(shapes.size())); };
        all_fit = bake_whole(s, shapes[i], callbacks) && all_fit;
      }
    });
    progress.require_not_stopped();
    if (all_fit) return;
    throw Failure(FT_ERROR_OUT_OF_MEMORY,
                  "ftBakeFields: whole fields take more memory than \"field_memory\" or the system gives them; "
                  "set coarser \"directions\" and \"plane\"");
  });
}

FTError ftSaveField(FTScene scene, uint32_t mesh, const char* path) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string file = text_of(path, "path");
    const Shared lock(s.mutex);
    s.require_commit("ftSaveField");
    const Field* const field = s.field_of(mesh);
    require(field != nullptr, "mesh " + std::to_string(mesh) + " has no field");
    require_no_input(s.scene, file);
    execute_in(s.device->arena, [&] { save_field(*field, field_identity(s.scene.shapes[mesh], s.parameters), file); });
  });
}

FTError ftLoadField(FTScene scene, uint32_t mesh, const char* path) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string file = text_of(path, "path");
    const Shared lock(s.mutex);
    s.require_commit("ftLoadField");
    Field* const field = s.field_of(mesh);
    require(field != nullptr, "mesh " + std::to_string(mesh) + " has no field");
    LoadedField loaded;
    execute_in(s.device->arena,
               [&] { loaded = load_field(*field, field_identity(s.scene.shapes[mesh], s.parameters), file); });
    if (!loaded.whole)
      throw Failure(FT_ERROR_OUT_OF_MEMORY,
                    "ftLoadField: \"field_memory\", or the system, has no room for all of the field; a part was read");
  });
}

FTError ftGetSceneInt(FTScene scene, const char* name, int64_t* value) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string key = text_of(name, "name");
    require_place(value, "ftGetSceneInt: the value");
    const Shared lock(s.mutex);
    if (key == "meshes" || key == "instances" || key == "width" || key == "height") {
      const Rect& crop = s.scene.film.crop;
      *value = key == "meshes"      ? clamped(s.scene.shapes.size())
               : key == "instances" ? clamped(s.scene.instances.size())
               : key == "width"     ? crop.width
                                    : crop.height;
      return;
    }
    s.require_commit("ftGetSceneInt");
    const auto number = field_numbers().find(key);
    uint64_t found = 0;
    if (key == "directions" || key == "plane") {
      found = uint64_t(key == "plane" ? s.parameters.plane : s.parameters.directions);
    } else if (key == "memory_exceeded") {
      found = s.fields->budget().exceeded() ? 1 : 0;
    } else {
      require(key == "fields" || number != field_numbers().end(), "there is no integer \"" + key + "\"");
      for (const Field* field : s.hit_fields) {
        if (field) found += key == "fields" ? 1 : number->second(*field, s.base_tolerance());
      }
    }
    *value = clamped(found);
  });
}

FTError ftGetMeshInt(FTScene scene, uint32_t mesh, const char* name, int64_t* value) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string key = text_of(name, "name");
    require_place(value, "ftGetMeshInt: the value");
    const Shared lock(s.mutex);
    s.require_commit("ftGetMeshInt");
    const Field* const field = s.field_of(mesh);
    const auto number = field_numbers().find(key);
    require(number != field_numbers().end(), "there is no integer \"" + key + "\"");
    *value = field ? clamped(number->second(*field, s.base_tolerance())) : 0;
  });
}

FTError ftGetSceneFloat(FTScene scene, const char* name, double* value) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string key = text_of(name, "name");
    require_place(value, "ftGetSceneFloat: the value");
    require(key == "certified_occlusion" || key == "certified_hits", "there is no float \"" + key + "\"");
    *value = (key == "certified_hits" ? s.hit_counts : s.occlusion_counts).share();
  });
}

FTError ftRender(FTScene scene, float* pixels, size_t pixel_stride, size_t row_stride) {
  return guarded(scene, [&](SceneObject& s) {
    const Shared lock(s.mutex);
    s.require_commit("ftRender");
    const auto width = size_t(s.scene.film.crop.width), height = size_t(s.scene.film.crop.height);
    require(pixels != nullptr, "ftRender: the pixels are null");
    const Buffer<float, 3> row("the row of pixels", pixels, pixel_stride, width);
    const size_t row_bytes = size_t(row.end() - row.begin());
    if (row_stride == 0) row_stride = pixel_stride == 0 ? width * 3 * sizeof(float) : width * pixel_stride;
    require(row_stride >= row_bytes && row_stride % alignof(float) == 0,
            "ftRender: the rows overlap, or their stride is no multiple of a float's size");
    const uintptr_t last = std::numeric_limits<uintptr_t>::max();
    require(row_stride <= last / 2 / height && row.begin() <= last - row_stride * height,
            "ftRender: the rows reach beyond memory");
    Progress progress(*s.device);
    const RenderResult result = render_scene(s, progress);
    for (size_t y = 0; y < height; ++y) {
      const Buffer<float, 3> target("the row of pixels",
                                    reinterpret_cast<float*>(reinterpret_cast<char*>(pixels) + y * row_stride),
                                    pixel_stride, width);
      for (size_t x = 0; x < width; ++x)
        std::memcpy(target.at(x), result.image.pixel(int(x), int(y)), 3 * sizeof(float));
    }
    progress.require_not_stopped();
  });
}

FTError ftRenderToFile(FTScene scene, const char* path) {
  return guarded(scene, [&](SceneObject& s) {
    const std::string file = text_of(path, "path");
    const Shared lock(s.mutex);
    s.require_commit("ftRenderToFile");
    const std::string ending = file_ending(file);
    require(ending == ".exr" || ending == ".png", "ftRenderToFile: end the name in .exr or .png");
    require_no_input(s.scene, file);
    require_image_writable(file);
    Progress progress(*s.device);
    const RenderResult result = render_scene(s, progress);
    progress.require_not_stopped();
    write_image(file, result.image);
  });
}
