#include "hybrid/stats/stats.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace fieldtrace {

void Stats::merge_counters(const Stats& o) {
  spp = std::max(spp, o.spp);
  if (o.by_rounds) {
    by_rounds = true;
    rounds = o.rounds;
    error_noise = o.error_noise, error_fields = o.error_fields, error_estimate = o.error_estimate;
    samples_mean = o.samples_mean, samples_fewest = o.samples_fewest, samples_most = o.samples_most;
  }
  time_primary += o.time_primary;
  time_secondary += o.time_secondary;
  rays_primary += o.rays_primary;
  rays_shadow += o.rays_shadow;
  rays_glossy += o.rays_glossy;
  rays_glossy_exact += o.rays_glossy_exact;
  rays_glossy_hits += o.rays_glossy_hits;
  rays_exact += o.rays_exact;
  rays_crossing += o.rays_crossing;
  rays_candidate_overflow += o.rays_candidate_overflow;
  lookups += o.lookups;
  add_bake(o);
  sphere_crossings += o.sphere_crossings;
  rays_open += o.rays_open;
  samples_spared += o.samples_spared;
  samples_by_strata += o.samples_by_strata;
  samples += o.samples;
  cones_clear += o.cones_clear;
  cones_blocked += o.cones_blocked;
  strata += o.strata;
  strata_refused += o.strata_refused;
  field_uses.resize(std::max(field_uses.size(), o.field_uses.size()));
  for (size_t s = 0; s < o.field_uses.size(); ++s) field_uses[s].merge(o.field_uses[s]);
  check_answers += o.check_answers;
  check_wrong += o.check_wrong;
  for (int bundle = 0; bundle < 2; ++bundle) check_bundles[bundle].merge(o.check_bundles[bundle]);
  for (int e = 0; e < k_checked_estimates; ++e) check_estimates[e].merge(o.check_estimates[e]);
  for (int verdict = 0; verdict < k_checked_verdicts; ++verdict) {
    for (int self = 0; self < 2; ++self) check_by[verdict][self].merge(o.check_by[verdict][self]);
  }
}

std::string Stats::to_json() const {
  nlohmann::ordered_json j;
  j["method"] = method;
  j["spp"] = spp;
  if (resumed) j["resumed"] = true;
  if (!slice.empty()) j["slice"] = slice;
  if (by_rounds) {
    j["target_error"] = target_error;
    j["time_limit"] = time_limit;
    j["rounds"] = rounds;
    j["error"] = {{"estimate", error_estimate}, {"noise", error_noise}, {"fields", error_fields}};
    j["samples_per_pixel"] = {{"mean", samples_mean}, {"fewest", samples_fewest}, {"most", samples_most}};
  }
  j["light_samples"] = light_samples;
  j["light_samples_open"] = open_light_samples;
  j["tolerance"] = tolerance;
  j["width"] = width;
  j["height"] = height;
  j["threads"] = threads;
  j["isa"] = isa;
  j["seed"] = seed;
  j["triangles"] = triangles;
  j["instances"] = instances;
  j["lights"] = lights;
  j["time"] = {{"load", time_load},       {"build", time_build},     {"cache", time_cache},
               {"bake", time_bake},       {"primary", time_primary}, {"secondary", time_secondary},
               {"denoise", time_denoise}, {"write", time_write},     {"total", time_total}};
  j["rays"] = {{"primary", rays_primary},         {"shadow", rays_shadow},
               {"glossy", rays_glossy},           {"glossy_exact", rays_glossy_exact},
               {"glossy_hits", rays_glossy_hits}, {"exact", rays_exact},
               {"crossing", rays_crossing},       {"crowded", rays_candidate_overflow},
               {"spared", samples_spared},        {"by_strata", samples_by_strata}};
  j["samples"] = {{"all", samples},
                  {"clusters", samples_by_clusters()},
                  {"strata", samples_by_strata},
                  {"cells", samples_by_cells()},
                  {"exact", rays_exact}};
  j["cones"] = {
      {"clear", cones_clear}, {"blocked", cones_blocked}, {"leaves", strata}, {"leaves_refused", strata_refused}};
  j["lookups"] = lookups;
  j["exact_fraction"] = exact_fraction();
  j["spheres_per_ray"] = spheres_per_ray();
  const auto count = [](const CheckCount& c) {
    return nlohmann::ordered_json{{"answers", c.answers}, {"wrong", c.wrong}};
  };
  j["check"] = {{"answers", check_answers}, {"wrong", check_wrong}};
  for (int v = 0; v < k_checked_verdicts; ++v) {
    j["check"][k_checked_verdict_names[v]] = {{"other", count(check_by[v][0])}, {"own", count(check_by[v][1])}};
  }
  j["check"]["clusters"] = count(check_bundles[int(CheckedBundle::cluster)]);
  j["check"]["cells"] = count(check_bundles[int(CheckedBundle::cell)]);
  const auto differences = [](const CheckedDifferences& d) {
    return nlohmann::json{{"compared", d.compared},
                          {"mean_difference", d.mean_difference()},
                          {"bias", d.bias()},
                          {"worst_difference", d.worst_difference()}};
  };
  for (int e = 0; e < k_checked_estimates; ++e) {
    j["check"][k_checked_estimate_names[e]] = differences(check_estimates[e]);
  }
  j["field"] = {
      {"objects", field_objects},           {"left_to_rays", field_left_to_rays}, {"own_to_rays", field_self_to_rays},
      {"survey_rays", survey_rays},         {"directions", field_directions},     {"plane", field_plane},
      {"cells_baked", field_cells_baked},   {"cells_full", field_cells_full},     {"tiles_baked", field_tiles_baked},
      {"bytes_memory", field_bytes_memory}, {"bytes_pictures", field_bytes_maps}, {"bytes_disk", field_bytes_disk},
      {"bytes_budget", field_bytes_budget}, {"bytes_peak", field_bytes_peak},     {"restarts", field_restarts}};
  j["sky"] = {{"objects", sky_objects}, {"directions", sky_directions}, {"texels", sky_texels}};
  j["bake"] = {{"rays", bake_rays}};
  j["device"] = {{"name", device},
                 {"blocks", device_blocks},
                 {"blocks_cpu", device_blocks_cpu},
                 {"waves", device_waves},
                 {"waves_full", device_waves_full},
                 {"samples", device_samples},
                 {"bytes_peak", device_bytes}};
  j["memory"] = {{"peak_bytes", memory_peak_bytes}};
  j["version"] = version;
  return j.dump(2) + "\n";
}

}  // namespace fieldtrace
