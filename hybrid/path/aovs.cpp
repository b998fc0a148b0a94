#include "hybrid/path/aovs.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

struct AovEntry {
  Aov aov;
  const char* name;
  const char* channels;  // one letter each
};
constexpr AovEntry k_entries[] = {
    {Aov::albedo, "albedo", "RGB"},
    {Aov::normal, "normal", "XYZ"},
    {Aov::depth, "depth", "Z"},
    {Aov::position, "position", "XYZ"},
    {Aov::visibility, "visibility", "Y"},
    {Aov::exact, "exact", "Y"},
    {Aov::object, "object", "Y"},
    {Aov::ao, "ao", "Y"},
    {Aov::reflected_depth, "reflected_depth", "Z"},
    {Aov::reflected_object, "reflected_object", "Y"},
    {Aov::glossy_exact, "glossy_exact", "Y"},
    {Aov::samples, "samples", "Y"},
    {Aov::variance, "variance", "RGB"},
    {Aov::time, "time", "Y"},
    {Aov::denoise_albedo, "denoise_albedo", "RGB"},
    {Aov::denoise_normal, "denoise_normal", "XYZ"},
};

float* put(float* out, const Vec3& v) {
  for (int c = 0; c < 3; ++c) *out++ = v[c];
  return out;
}

}  // namespace

std::vector<std::string> aov_names() {
  std::vector<std::string> names;
  for (const AovEntry& entry : k_entries) names.push_back(entry.name);
  return names;
}

std::vector<Aov> parse_aovs(const std::vector<std::string>& names) {
  std::vector<Aov> result;
  for (const std::string& name : names) {
    const auto* entry =
        std::find_if(std::begin(k_entries), std::end(k_entries), [&](const AovEntry& e) { return name == e.name; });
    if (entry == std::end(k_entries))
      throw UsageError(fmt::format("unknown AOV '{}'; known are {}", name, fmt::join(aov_names(), ", ")));
    if (std::find(result.begin(), result.end(), entry->aov) == result.end()) result.push_back(entry->aov);
  }
  return result;
}

std::vector<std::string> aov_channels(Aov aov) {
  std::vector<std::string> channels;
  for (const AovEntry& e : k_entries) {
    if (e.aov != aov) continue;
    for (const char* c = e.channels; *c; ++c) channels.push_back(std::string(e.name) + "." + *c);
  }
  return channels;
}

bool is_of_first_hits(Aov aov) { return aov != Aov::samples && aov != Aov::variance && aov != Aov::time; }

void AovSums::add(const FirstHit& first) {
  if (samples == 0) object = first.object;
  ++samples;
  if (first.hit) {
    ++hits;
    albedo += DVec3(first.albedo);
    normal += DVec3(first.normal);
    depth += first.depth;
    position += first.position;
    denoise_albedo += DVec3(first.shown_albedo);
    denoise_normal += DVec3(first.shown_normal);
  }
  visibility += first.shadow_rays > 0.0f ? double(first.shadow_clear) / double(first.shadow_rays) : 1.0;
  exact += first.shadow_rays > 0.0f ? std::min(double(first.shadow_exact) / double(first.shadow_rays), 1.0) : 0.0;
  if (glossy_rays == 0) reflected_object = first.reflected_object;
  glossy_rays += first.glossy_rays;
  glossy_exact += first.glossy_exact;
  reflected_hits += first.reflected_hits;
  reflected_depth += first.reflected_depth;
  occlusion_rays += first.occlusion_rays;
  occlusion_clear += first.occlusion_clear;
}

void AovSums::merge(const AovSums& later) {
  if (samples == 0) object = later.object;
  if (glossy_rays == 0) reflected_object = later.reflected_object;
  samples += later.samples;
  hits += later.hits;
  albedo += later.albedo;
  normal += later.normal;
  depth += later.depth;
  position += later.position;
  denoise_albedo += later.denoise_albedo;
  denoise_normal += later.denoise_normal;
  visibility += later.visibility;
  exact += later.exact;
  occlusion_rays += later.occlusion_rays;
  occlusion_clear += later.occlusion_clear;
  glossy_rays += later.glossy_rays;
  glossy_exact += later.glossy_exact;
  reflected_hits += later.reflected_hits;
  reflected_depth += later.reflected_depth;
}

float* AovSums::write(Aov aov, float* out) const {
  const double per_sample = samples ? 1.0 / samples : 0.0;
  const double per_hit = hits ? 1.0 / hits : 0.0;
  switch (aov) {
    case Aov::albedo:
      return put(out, Vec3(albedo * per_sample));
    case Aov::normal:
      return put(out, Vec3(normal * per_sample));
    case Aov::depth:
      *out = float(depth * per_hit);
      break;
    case Aov::position:
      return put(out, Vec3(position * per_hit));
    case Aov::visibility:
      *out = float(visibility * per_sample);
      break;
    case Aov::exact:
      *out = float(exact * per_sample);
      break;
    case Aov::object:
      *out = float(object);
      break;
    case Aov::ao: {
      // Maps estimate, and may err on the bright side.
      const double clear = occlusion_rays > 0.0 ? std::min(occlusion_clear / occlusion_rays, 1.0) : 1.0;
      *out = float((hits * clear + (samples - hits)) * per_sample);
      break;
    }
    case Aov::reflected_depth:
      *out = reflected_hits ? float(reflected_depth / double(reflected_hits)) : 0.0f;
      break;
    case Aov::reflected_object:
      *out = float(reflected_object);
      break;
    case Aov::glossy_exact:
      *out = glossy_rays ? float(double(glossy_exact) / double(glossy_rays)) : 0.0f;
      break;
    case Aov::denoise_albedo:
      return put(out, Vec3(denoise_albedo * per_sample));
    case Aov::denoise_normal:
      return put(out, Vec3(denoise_normal * per_sample));
    case Aov::samples:
    case Aov::variance:
    case Aov::time:
      return out;
  }
  return out + 1;
}

}  // namespace fieldtrace
