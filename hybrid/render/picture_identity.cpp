#include "hybrid/render/picture_identity.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "core/platform/error.h"
#include "field/file/field_identity.h"
#include "field/file/hash.h"
#include "hybrid/render/render_tiles.h"

namespace fieldtrace {
namespace {

// Names and values of users need not be UTF-8; files that hold an identity must be. Others are spelt by bytes.
std::string valid_utf8(const std::string& text) {
  try {
    (void)nlohmann::json(text).dump();
    return text;
  } catch (const nlohmann::json::type_error&) {
  }
  std::string spelt = "bytes ";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    spelt += byte < 0x80 && c != '\\' ? std::string(1, c) : fmt::format("\\x{:02x}", byte);
  }
  return spelt;
}

const char* name_of(LightEstimator e) {
  return e == LightEstimator::samples ? "samples" : e == LightEstimator::adaptive ? "adaptive" : "automatic";
}

const char* name_of(FieldHits hits) {
  return hits == FieldHits::always ? "always" : hits == FieldHits::never ? "never" : "auto";
}

}  // namespace

PictureIdentity picture_identity(const Picture& picture) {
  const RenderOptions& o = picture.options;
  const Scene& scene = picture.scene;
  const auto text = [](const auto& value) { return fmt::format("{}", value); };
  const Rect& w = picture.window;
  PictureIdentity identity = {
      {"the version", fmt::format("{}, fields {}", FIELDTRACE_VERSION, k_field_format_version)},
      {"--method", o.method == Method::hybrid ? "hybrid" : "montecarlo"},
      {"--chart", o.chart == Chart::thesis ? "thesis" : "orthographic"},
      {"--seed", text(picture.settings.seed)},
      {"--light-samples", text(o.light_samples)},
      {"--light-estimator", name_of(o.light_estimator)},
      {"--lobe-samples", text(o.lobe_samples)},
      {"--tolerance", o.tolerance ? text(*o.tolerance) : "by default"},
      {"--directions", text(o.directions)},
      {"--plane", text(o.plane)},
      {"--field-hits", name_of(o.field_hits)},
      {"--field-memory", text(o.field_memory)},
      {"what answers", fmt::format("{:d}{:d}{:d}", o.force_undecided, o.whole_lights, o.leave_to_rays)},
      {"--max-depth", text(picture.settings.max_depth)},
      {"--aov", fmt::format("{}", fmt::join(o.aovs, ","))},
      {"--ao-distance", text(o.ao_distance)},
      {"the crop window", fmt::format("{},{},{},{}", w.x, w.y, w.width, w.height)},
      {"--target-error or --time-limit", o.by_rounds() ? "given" : "absent"},
      {"the error's measure", o.error_measure == ErrorMeasure::relative ? "relative" : "absolute"},
      {"the film", fmt::format("{} x {}", scene.film.width, scene.film.height)},
      {"the scene", fmt::format("{} instances, {} triangles, {} emitters", scene.instances.size(),
                                scene.triangle_count(), scene.emitters.size())}};
  for (const auto& [name, value] : scene.parameters) identity.push_back({"-D " + name, value});
  // By their names alone: the same scene may be reached by another path.
  std::map<std::string, std::string> files;
  for (const std::string& path : std::set<std::string>(scene.files.begin(), scene.files.end())) {
    Hasher hasher;
    if (!hasher.add_file(path)) throw Error({path}, "cannot be read again, to see which scene this is");
    files[std::filesystem::path(path).filename().string()] += hasher.result().hex();
  }
  for (const auto& [name, hash] : files) identity.push_back({"the file " + name, hash});
  for (auto& [name, value] : identity) name = valid_utf8(name), value = valid_utf8(value);
  return identity;
}

Part part_of(const Picture& picture) {
  Part part;
  part.slice = *picture.options.slice;
  part.window = picture.window;
  part.traced = traced_pixels(picture);
  part.identity = picture_identity(picture);
  part.identity.push_back({"--spp", std::to_string(picture.spp)});
  part.channels = make_image(picture.window, picture.aovs).channels;
  return part;
}

}  // namespace fieldtrace
