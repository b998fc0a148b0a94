// `fieldtrace info`: what is in a scene, a mesh, an image or a field.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/image/image.h"
#include "core/io/file_ending.h"
#include "core/mesh/mesh_io.h"
#include "field/file/field_info.h"
#include "field/file/maps_file.h"
#include "field/file/thesis_file.h"
#include "hybrid/film/part.h"
#include "hybrid/visibility/visibility_device.h"
#include "tools/cli/command.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"

namespace fieldtrace {

namespace {

std::string vector_text(const Vec3& v) { return fmt::format("({:.6g}, {:.6g}, {:.6g})", v.x, v.y, v.z); }

std::string bounds_text(const Bounds3& b) {
  return b.empty() ? "empty" : vector_text(b.lower) + " to " + vector_text(b.upper);
}

void print_mesh(const std::string& path) {
  ProgressLine progress(false);
  const TriangleMesh mesh = load_mesh(path, {}, print_warnings(progress));
  fmt::print("mesh       {}\nvertices   {}\ntriangles  {}\nnormals    {}\ntexcoords  {}\nbounds     {}\n", path,
             mesh.positions.size(), mesh.triangles.size(), mesh.normals.empty() ? "no" : "yes",
             mesh.texcoords.empty() ? "no" : "yes", bounds_text(mesh.bounds()));
}

void print_image(const std::string& path) {
  std::map<std::string, std::string> metadata;
  ImageReadOptions options;
  options.metadata = &metadata;
  const Image image = read_image(path, options);
  fmt::print("image      {}\nsize       {}x{}\n", path, image.width, image.height);
  if (const auto slice = slice_of(metadata)) fmt::print("slice      {}\n", slice_text(*slice));
  for (size_t c = 0; c < image.channel_count(); ++c) {
    double sum = 0.0;
    float least = k_infinity, most = -k_infinity;
    uint64_t not_finite = 0;
    for (size_t i = c; i < image.data.size(); i += image.channel_count()) {
      const float v = image.data[i];
      if (!std::isfinite(v)) {
        ++not_finite;
        continue;
      }
      sum += v;
      least = std::min(least, v);
      most = std::max(most, v);
    }
    const uint64_t finite = image.data.size() / image.channel_count() - not_finite;
    fmt::print("channel    {}: ", image.channels[c]);
    if (finite > 0) fmt::print("{:.6g} to {:.6g}, mean {:.6g}", least, most, sum / double(finite));
    fmt::print("{}\n", not_finite > 0 ? fmt::format(" ({} values not finite)", not_finite) : "");
  }
}

const char* kind_text(EmitterKind kind) {
  switch (kind) {
    case EmitterKind::area:
      return "area";
    case EmitterKind::constant:
      return "constant";
    case EmitterKind::environment:
      return "envmap";
    case EmitterKind::point:
      return "point";
    case EmitterKind::directional:
      return "directional";
  }
  return "";
}

void print_scene(const SceneArguments& arguments) {
  ProgressLine progress(false);
  const Scene scene = load_scene(arguments, progress);
  const Film& film = scene.film;
  fmt::print("scene      {}\nfilm       {}x{}", arguments.path, film.width, film.height);
  if (film.crop.width != film.width || film.crop.height != film.height) {
    fmt::print(", crop {},{},{},{}", film.crop.x, film.crop.y, film.crop.width, film.crop.height);
  }
  fmt::print("\nsamples    {}, seed {}\ndepth      {}\ntriangles  {} over {} instances of {} shapes\n",
             scene.sample_count, scene.seed, scene.integrator.max_depth, scene.triangle_count(), scene.instances.size(),
             scene.shapes.size());
  fmt::print("bounds     {}\n", bounds_text(scene.world_bounds()));
  if (scene.origin != DVec3(0.0)) {
    fmt::print("origin     ({:.9g}, {:.9g}, {:.9g})\n", scene.origin.x, scene.origin.y, scene.origin.z);
  }
  std::vector<size_t> uses(scene.shapes.size(), 0);
  for (const Instance& instance : scene.instances) ++uses[instance.shape];
  for (size_t s = 0; s < scene.shapes.size(); ++s) {
    fmt::print("shape      {}: {} triangles, {} instance{}\n", scene.shapes[s].name, scene.shapes[s].triangle_count(),
               uses[s], uses[s] == 1 ? "" : "s");
  }
  for (const Emitter& emitter : scene.emitters) {
    fmt::print("light      {} {}\n", kind_text(emitter.kind), vector_text(emitter.value));
  }
}

double percent(uint64_t part, uint64_t whole) { return whole ? 100.0 * double(part) / double(whole) : 0.0; }

void print_baked(const char* name, const LayerInfo& layer, uint64_t cells_full) {
  fmt::print("{:<10} {} of {} cells ({:.2f} %), {:.2f} % of the {} that queries reach\n", name, layer.cells_baked,
             cells_full, percent(layer.cells_baked, cells_full), percent(layer.cells_baked, layer.cells_reachable),
             layer.cells_reachable);
}

// `cells`: the number of cells, in the chart's terms.
void print_header(const std::string& path, const FieldFileHeader& header, const std::string& cells) {
  const FieldIdentity& identity = header.identity;
  fmt::print("field      {}\nchart      {}\ncells      {}\n", path, identity.chart, cells);
  fmt::print("sphere     centre {}, R {:.6g}\n", vector_text(header.ball.centre), header.ball.radius);
  fmt::print("mesh       {}, {} primitives\nformat     {}\n", identity.geometry.hex(), identity.primitive_count,
             identity.format_version);
  fmt::print("cache name {}\n", identity.file_name());
}

void print_thesis_field(const std::string& path) {
  const ThesisFileInfo info = thesis_file_info(path);
  print_header(path, info.header, fmt::format("M {}", info.header.identity.parameters.directions));
  fmt::print("samples    {}, {:.1f} % miss, {} normals\n", info.samples, percent(info.misses, info.samples),
             info.has_normals ? "with" : "no");
  fmt::print("bytes      {} on disk, {} in memory\n", info.bytes_disk, info.bytes_memory);
}

void print_maps(const std::string& path) {
  const MapsFileInfo info = maps_file_info(path);
  print_header(path, info.header, fmt::format("D {}, T {}", info.size.directions, info.size.texels));
  fmt::print("texels     {}, {:.1f} % hit\n", info.size.lines(), percent(info.hits, info.size.lines()));
  fmt::print("bytes      {} on disk, {} in memory\n", info.bytes_disk, info.bytes_memory);
}

void print_field(const std::string& path) {
  const FieldFileInfo info = field_info(path);
  const FieldParameters& p = info.header.identity.parameters;
  print_header(path, info.header, fmt::format("D {}, N {}, K {}", p.directions, p.plane, p.lines));
  const auto share = [](const LayerInfo& layer, uint64_t cells) { return percent(cells, layer.cells_baked); };
  const LayerInfo &v = info.visibility, &d = info.depth;
  print_baked("visibility", v, info.cells_full);
  fmt::print("           clear {:.1f} %, blocked {:.1f} %, undecided {:.1f} %, at tolerance {}\n", share(v, v.clear),
             share(v, v.blocked), share(v, v.undecided), k_default_tolerance);
  print_baked("depth", d, info.cells_full);
  fmt::print(
      "           miss {:.1f} %, plane fit {:.1f} %, one-sided bound {:.1f} %, undecided {:.1f} %, at tolerance {}\n",
      share(d, d.clear), share(d, d.blocked - d.one_sided), share(d, d.one_sided), share(d, d.undecided),
      k_default_tolerance);
  fmt::print("primitive  {} cells\n", info.primitives_baked);
  const CoverageInfo& c = info.coverage;
  fmt::print("coverage   {} of {} tiles ({:.2f} %), {} x {} lines a direction\n", c.tiles_baked, c.tiles_full,
             percent(c.tiles_baked, c.tiles_full), c.lines_across, c.lines_across);
  fmt::print("           {} lines, {:.1f} % hit, {} tiles empty\n", c.lines_baked, percent(c.lines_hit, c.lines_baked),
             c.tiles_empty);
  fmt::print("bytes      {} on disk, {} in memory, {} bricks\n", info.bytes_disk, info.bytes_memory, info.bricks);
  fmt::print("           {} of cells and {} of coverage, {:.2f} to 1 on disk\n", info.bytes_cells, info.bytes_coverage,
             info.compression());
}

using Json = nlohmann::ordered_json;

// Names of files need not be UTF-8.
void print_json(const Json& json) {
  fmt::print("{}\n", json.dump(2, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace));
}

// Entries common to fields of all charts; `cells`: the chart's parameters.
Json header_json(const std::string& path, const FieldFileHeader& header, const Json& cells) {
  const FieldIdentity& identity = header.identity;
  const Vec3& centre = header.ball.centre;
  Json json = {{"file", path}, {"chart", identity.chart}};
  json.update(cells);
  json.update(Json{{"centre", {centre.x, centre.y, centre.z}},
                   {"radius", header.ball.radius},
                   {"mesh_hash", identity.geometry.hex()},
                   {"primitives", identity.primitive_count},
                   {"format", identity.format_version},
                   {"cache_name", identity.file_name()}});
  return json;
}

void print_thesis_field_json(const std::string& path) {
  const ThesisFileInfo info = thesis_file_info(path);
  Json json = header_json(path, info.header, {{"directions", info.header.identity.parameters.directions}});
  json.update(Json{{"samples", info.samples},
                   {"misses", info.misses},
                   {"normals", info.has_normals},
                   {"bytes", {{"disk", info.bytes_disk}, {"memory", info.bytes_memory}}}});
  print_json(json);
}

void print_maps_json(const std::string& path) {
  const MapsFileInfo info = maps_file_info(path);
  Json json =
      header_json(path, info.header, {{"directions", info.size.directions}, {"texels_across", info.size.texels}});
  json.update(Json{{"texels", info.size.lines()},
                   {"hits", info.hits},
                   {"bytes", {{"disk", info.bytes_disk}, {"memory", info.bytes_memory}}}});
  print_json(json);
}

void print_field_json(const std::string& path) {
  const FieldFileInfo info = field_info(path);
  const FieldParameters& p = info.header.identity.parameters;
  const auto layer = [&](const LayerInfo& l) {
    return Json{
        {"cells_baked", l.cells_baked}, {"cells_reachable", l.cells_reachable}, {"cells_full", info.cells_full}};
  };
  const LayerInfo &v = info.visibility, &d = info.depth;
  Json visibility = layer(v), depth = layer(d);
  visibility.update(Json{{"clear", v.clear}, {"blocked", v.blocked}, {"undecided", v.undecided}});
  depth.update(Json{{"miss", d.clear},
                    {"plane_fit", d.blocked - d.one_sided},
                    {"one_sided_bound", d.one_sided},
                    {"undecided", d.undecided}});
  const CoverageInfo& c = info.coverage;
  Json json = header_json(path, info.header, {{"directions", p.directions}, {"plane", p.plane}, {"lines", p.lines}});
  json.update(Json{{"tolerance", std::round(double(k_default_tolerance) * 1e6) / 1e6},
                   {"visibility", visibility},
                   {"depth", depth},
                   {"primitives_baked", info.primitives_baked},
                   {"coverage",
                    {{"tiles_baked", c.tiles_baked},
                     {"tiles_full", c.tiles_full},
                     {"tiles_empty", c.tiles_empty},
                     {"lines_across", c.lines_across},
                     {"lines_baked", c.lines_baked},
                     {"lines_hit", c.lines_hit}}},
                   {"bricks", info.bricks},
                   {"bytes",
                    {{"disk", info.bytes_disk},
                     {"memory", info.bytes_memory},
                     {"cells", info.bytes_cells},
                     {"coverage", info.bytes_coverage}}},
                   {"compression", info.compression()}});
  print_json(json);
}

void print_field_file(const std::string& path, bool json) {
  const std::string chart = field_file_chart(path);
  if (chart == k_chart_thesis) {
    (json ? print_thesis_field_json : print_thesis_field)(path);
  } else if (chart == k_chart_maps) {
    (json ? print_maps_json : print_maps)(path);
  } else {
    (json ? print_field_json : print_field)(path);
  }
}

struct InfoArguments {
  SceneArguments file;
  bool json = false, devices = false;
};

void print_devices() {
  std::vector<const char*> isas;
  for (const Isa isa : supported_isas()) isas.push_back(isa_name(isa));
  fmt::print("cpu        {} threads, {}\n", std::thread::hardware_concurrency(), fmt::join(isas, ", "));
  for (const DeviceKind& kind : device_kinds()) {
    for (const std::string& line : kind.list()) fmt::print("{:<10} {}\n", kind.name, line);
    if (!kind.lacks.empty()) fmt::print("{:<10} cannot be used: {}\n", kind.name, kind.lacks);
  }
}

int run_info(const InfoArguments& arguments) {
  if (arguments.devices) {
    print_devices();
    return k_exit_success;
  }
  const std::string& path = arguments.file.path;
  const std::string ending = file_ending(path);
  if (arguments.json && ending != ".vdb") {
    throw UsageError("--json: only of fields; " + path + " does not end in .vdb");
  }
  if (ending != ".xml") refuse_scene_reading_options(arguments.file);
  if (ending == ".vdb") {
    print_field_file(path, arguments.json);
  } else if (ending == ".xml") {
    print_scene(arguments.file);
  } else if (ending == ".obj" || ending == ".ply") {
    print_mesh(path);
  } else {
    print_image(path);
  }
  return k_exit_success;
}

}  // namespace

void add_info_command(CommandLine& line) {
  const auto arguments = std::make_shared<InfoArguments>();
  CLI::App& command = *line.app.add_subcommand("info", "Say what is in a scene, a mesh, an image or a field");
  CLI::Option* const file =
      command.add_option("file", arguments->file.path, "Scene (.xml), mesh (.obj, .ply), field (.vdb) or image")
          ->type_name("FILE");
  CLI::Option* const devices =
      command.add_flag("--devices", arguments->devices, "List the devices that --device names, instead of a file");
  devices->excludes(file);
  devices->excludes(command.add_flag("--json", arguments->json, "Print JSON (fields only)"));
  add_scene_reading_options(command, arguments->file);
  command.callback([arguments, file, devices, &line] {
    if (file->empty() && devices->empty()) throw CLI::RequiredError("file");
    line.action = [arguments] { return run_info(*arguments); };
  });
}

}  // namespace fieldtrace
