#include "hybrid/render/sky_stage.h"

#include <algorithm>
#include <cstdlib>

#include "field/store/field.h"
#include "field/store/risk_classes.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {
namespace {

bool has_sky(const Scene& scene) {
  return std::any_of(scene.emitters.begin(), scene.emitters.end(), [](const Emitter& e) { return is_sky(e.kind); });
}

// Rays that a picture sends to the sky for each that its maps may cost.
constexpr uint64_t k_map_gain = 4;

}  // namespace

std::unique_ptr<SkyMaps> make_sky_maps(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                                       const RenderOptions& options, uint64_t light_samples,
                                       const RenderCallbacks& callbacks, Stats& stats) {
  if (!has_sky(scene) || !(options.tolerance > 0.0f) || options.force_undecided) return nullptr;
  std::vector<uint32_t> wanted;
  std::vector<uint8_t> is_used(scene.shapes.size(), 0);
  for (const Instance& i : scene.instances) is_used[i.shape] = 1;
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    if (is_used[s] && scene.shapes[s].kind != ShapeKind::rectangle && !traits[s].is_flat) wanted.push_back(s);
  }
  MapSize size;
  if (const char* d = std::getenv("FT_SKY_D")) size.directions = std::atoi(d);
  if (const char* d = std::getenv("FT_SKY_T")) size.texels = std::atoi(d);
  SkyTolerance tolerance;
  if (const char* d = std::getenv("FT_SKY_M")) tolerance.margin = float(std::atof(d));
  if (const char* d = std::getenv("FT_SKY_LO")) tolerance.clear_within = float(std::atof(d));
  if (const char* d = std::getenv("FT_SKY_HI")) tolerance.hidden_from = float(std::atof(d));
  const uint64_t affordable = 2 * light_samples / k_map_gain;
  const auto bake_rays = [&] { return size.lines() * wanted.size(); };
  if (bake_rays() > affordable && !std::getenv("FT_SKY_D")) size.directions /= 2;
  if (bake_rays() > affordable && !std::getenv("FT_SKY_D")) return nullptr;
  std::vector<std::unique_ptr<DirectionMaps>> maps(scene.shapes.size());
  BakeCounters counters;
  for (const uint32_t s : wanted) {
    maps[s] = std::make_unique<DirectionMaps>(field_ball(scene.shapes[s].bounds), size);
    if (!bake_maps(*maps[s], accel, s, callbacks.stop, counters)) break;
  }
  stats.bake_rays += counters.rays;
  stats.time_bake += counters.seconds * std::max(options.threads, 1);
  return std::make_unique<SkyMaps>(scene, traits, std::move(maps), size.directions, tolerance);
}

}  // namespace fieldtrace
