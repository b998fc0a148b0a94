#include "hybrid/render/picture_identity.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "core/platform/error.h"
#include "field/file/field_identity.h"
#include "field/file/hash.h"
#include "hybrid/render/render_tiles.h"

namespace fieldtrace {
namespace {

std::string hash_of_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  Hasher hasher;
  std::vector<char> part(1 << 20);
  while (file.read(part.data(), std::streamsize(part.size())) || file.gcount() > 0)
    hasher.add(part.data(), size_t(file.gcount()));
  if (!file.eof()) throw Error({path}, "cannot be read again, to see which scene this is");
  return hasher.result().hex();
}

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

const char* name_of(LightEstimator estimator) {
  switch (estimator) {
    case LightEstimator::samples:
      return "samples";
    case LightEstimator::adaptive:
      return "adaptive";
    case LightEstimator::automatic:
      break;
  }
  return "automatic";
}

const char* name_of(FieldHits hits) {
  return hits == FieldHits::always ? "always" : hits == FieldHits::never ? "never" : "auto";
}

}  // namespace

PictureIdentity picture_identity(const Picture& picture) {
  const RenderOptions& o = picture.options;
  const Scene& scene = picture.scene;
  const auto text = [](const auto& value) { return fmt::format("{}", value); };
  std::string layers;
  for (const std::string& name : o.aovs) layers += (layers.empty() ? "" : ",") + name;
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
      {"--aov", layers},
      {"--ao-distance", text(o.ao_distance)},
      {"the crop window", fmt::format("{},{},{},{}", w.x, w.y, w.width, w.height)},
      {"--target-error or --time-limit", o.by_rounds() ? "given" : "not given"},
      {"the error's measure", o.error_measure == ErrorMeasure::relative ? "relative" : "absolute"},
      {"the film", fmt::format("{} x {}", scene.film.width, scene.film.height)},
      {"the scene", fmt::format("{} instances, {} triangles, {} emitters", scene.instances.size(),
                                scene.triangle_count(), scene.emitters.size())}};
  for (const auto& [name, value] : scene.parameters) identity.push_back({"-D " + name, value});
  // By their names alone: the same scene may be reached by another path.
  std::map<std::string, std::string> files;
  for (const std::string& path : std::set<std::string>(scene.files.begin(), scene.files.end()))
    files[std::filesystem::path(path).filename().string()] += hash_of_file(path);
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
