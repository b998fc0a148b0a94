// What a render did: the counters and times behind `--stats` (keys: see to_json in stats.cpp).
//
// Times are wall seconds. Stages that run inside parallel tiles are measured per thread, summed and divided by the
// number of threads, so that time.primary + time.secondary + time.bake stay below time.total.
// Thread-safety: each worker fills its own Stats; merge_counters() adds them on one thread.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "field/bake/bake.h"

namespace fieldtrace {

// Uses of one object's field. Of rays that cross its bounds, and of light samples spared, those for shading points on
// the object itself, by whether the field answered them; of all, how many there may be.
struct FieldUse {
  uint64_t self_answered = 0, self_undecided = 0;
  uint64_t met = 0, self_met = 0;  // light samples whose way may cross the object's bounds

  void add_met(uint32_t samples, bool self) {
    met += samples;
    self_met += self ? samples : 0;
  }
  void merge(const FieldUse& o) {
    self_answered += o.self_answered, self_undecided += o.self_undecided;
    met += o.met, self_met += o.self_met;
  }
};

// Verdicts that --check counts: of shadow rays (clear, blocked) and of glossy rays (miss, hit).
enum class CheckedVerdict { clear, blocked, miss, hit };
inline constexpr int k_checked_verdicts = 4;
inline constexpr const char* k_checked_verdict_names[k_checked_verdicts] = {"clear", "blocked", "miss", "hit"};

// What gave such an answer: a whole light seen from a cluster, or a cell for a single ray.
enum class CheckedBundle { cluster, cell };

// Estimates that --check compares with rays.
enum class CheckedEstimate {
  strata,      // shares of lights' strata
  irradiance,  // of clusters, by one light; unit: what arrives unhidden
  sky,         // shares of direction cells of the sky
  arriving,    // irradiance by the sky; unit: the open sky's
  indirect,    // irradiance by what objects send on, likewise
  fitted,      // irradiance of pixels that was fitted to others', likewise
  surfels,     // radiance of surfels; unit: their mean
  lobes        // radiance along glossy rays, by radiance maps; unit: what rays find
};
inline constexpr int k_checked_estimates = 8;
inline constexpr const char* k_checked_estimate_names[k_checked_estimates] = {
    "strata", "irradiance", "sky", "arriving", "indirect", "fitted", "surfels", "lobes"};

// Their differences. Each comes with the unit that it is measured in, and results are in means of these: a difference
// counts little where next to nothing arrives.
struct CheckedDifferences {
  uint64_t compared = 0;
  double units = 0.0, sizes = 0.0, sum = 0.0, largest = 0.0;

  double mean_difference() const { return sizes / unit_sum(); }
  double bias() const { return sum / unit_sum(); }
  double worst_difference() const { return largest * double(compared) / unit_sum(); }

  void add(double difference, double unit = 1.0) {
    compared += 1;
    units += unit;
    sizes += std::abs(difference), sum += difference;
    largest = std::max(largest, std::abs(difference));
  }
  void merge(const CheckedDifferences& o) {
    compared += o.compared;
    units += o.units, sizes += o.sizes, sum += o.sum;
    largest = std::max(largest, o.largest);
  }

 private:
  double unit_sum() const { return units > 0.0 ? units : 1.0; }
};

struct Stats {
  std::string method;
  int spp = 0, light_samples = 0;
  int open_light_samples = 0;  // of each camera sample where a light may be hidden
  float tolerance = 0.0f;
  int width = 0, height = 0, threads = 0;
  std::string isa, device;
  uint32_t seed = 0;
  uint64_t triangles = 0, instances = 0, lights = 0;
  // Of pictures by rounds: the error asked for, and what was found: of noise, of fields, of both; samples of a pixel.
  double target_error = 0, time_limit = 0;
  bool by_rounds = false;
  uint32_t rounds = 0;  // finished
  bool resumed = false;
  std::string slice;  // "K/N"; empty: the whole picture
  double error_noise = 0, error_fields = 0, error_estimate = 0;
  double samples_mean = 0;
  uint32_t samples_fewest = 0, samples_most = 0;

  double time_load = 0, time_bake = 0, time_primary = 0, time_secondary = 0, time_total = 0;
  double time_build = 0;  // Embree's acceleration structures
  double time_cache = 0;  // reading fields from the cache before the picture, and storing them after it
  double time_write = 0;  // writing the images
  double time_denoise = 0;

  uint64_t rays_primary = 0;             // camera rays and the bounces that follow them
  uint64_t rays_shadow = 0;              // shadow rays generated (those that cross no candidate's bounds included)
  uint64_t rays_glossy = 0;              // rays that left a surface along a specular or glossy lobe
  uint64_t rays_glossy_exact = 0;        // those traced because no radiance map and no certified hit answered them
  uint64_t rays_glossy_hits = 0;         // those that fields answered for at least one object, by a hit or a miss
  uint64_t rays_exact = 0;               // shadow rays traced through Embree
  uint64_t rays_crossing = 0;            // shadow rays that cross at least one candidate's bounds
  uint64_t rays_open = 0;                // those of them that leave camera rays' surfaces towards lights
  uint64_t rays_candidate_overflow = 0;  // those of rays_exact whose group had candidate overflow
  uint64_t lookups = 0;                  // ray-field look-ups
  uint64_t sphere_crossings = 0;         // ray-candidate pairs whose bounds are crossed
  uint64_t cones_clear = 0, cones_blocked = 0;  // (shading point, candidate) pairs settled as whole lights
  // Strata of lights above their shading points' horizons: those looked up in fields, and those of shading points for
  // which some field refused.
  uint64_t strata = 0, strata_refused = 0;
  // Light samples across a candidate's bounds answered without rays, with their whole light or by its strata; and the
  // latter of these.
  uint64_t samples_spared = 0, samples_by_strata = 0;
  uint64_t samples = 0;  // all light samples of all shading points
  uint64_t check_answers = 0, check_wrong = 0;
  // check_by[CheckedVerdict][self]: 1 for shading points on the object itself, else 0.
  struct CheckCount {
    uint64_t answers = 0, wrong = 0;
    void merge(const CheckCount& o) { answers += o.answers, wrong += o.wrong; }
  };
  CheckCount check_by[k_checked_verdicts][2];
  CheckCount check_bundles[2];                              // by CheckedBundle
  CheckedDifferences check_estimates[k_checked_estimates];  // by CheckedEstimate

  int field_directions = 0, field_plane = 0;
  uint64_t field_objects = 0;        // objects answered by fields, for shadow rays or glossy ones
  uint64_t field_left_to_rays = 0;   // objects that could have a field but are left to exact rays for shadows
  uint64_t field_self_to_rays = 0;   // objects whose field is not used for rays from the object itself
  uint64_t survey_rays = 0;          // shadow rays of surveys, not in rays_exact
  std::vector<FieldUse> field_uses;  // per shape; empty unless counted (hybrid/render/field_survey.h)
  uint64_t field_cells_baked = 0, field_cells_full = 0, field_bytes_memory = 0, field_bytes_disk = 0;
  uint64_t field_tiles_baked = 0;  // coverage tiles
  uint64_t field_bytes_maps = 0;   // prefiltered radiance maps, and direction maps of skies
  uint64_t sky_objects = 0;        // with direction maps, of which:
  int sky_directions = 0, sky_texels = 0;
  uint64_t field_bytes_budget = 0, field_bytes_peak = 0;
  uint64_t field_restarts = 0;  // attempts that exceeded the budget
  uint64_t bake_rays = 0;
  // Of a device other than the CPU: blocks of 32 rays or shading points that it answered, those that it left to the
  // CPU, waits for it, those for k_wave_samples light samples or more, the light samples of all
  // (hybrid/visibility/visibility_device.h), and the most bytes of its memory.
  uint64_t device_blocks = 0, device_blocks_cpu = 0, device_waves = 0, device_waves_full = 0, device_samples = 0;
  uint64_t device_bytes = 0;
  uint64_t memory_peak_bytes = 0;
  std::string version;

  // Light samples by what answered them, besides strata and exact rays.
  uint64_t samples_by_clusters() const { return samples_spared - samples_by_strata; }
  uint64_t samples_by_cells() const { return rays_crossing - rays_exact; }
  // The share of light samples across a candidate's bounds, sent as rays or spared, that were traced; 0 if there were
  // none.
  double exact_fraction() const {
    const uint64_t all = rays_crossing + samples_spared;
    return all ? double(rays_exact) / double(all) : 0.0;
  }
  // Mean number of candidates' bounds that a crossing ray crosses.
  double spheres_per_ray() const { return rays_crossing ? double(sphere_crossings) / double(rays_crossing) : 0.0; }

  // Counts one checked answer. `self`: whether the shading point lies on the object itself.
  void add_check(CheckedVerdict verdict, CheckedBundle bundle, bool self, bool wrong) {
    check_bundles[int(bundle)].merge({1, wrong});
    check_answers += 1;
    check_wrong += wrong;
    check_by[int(verdict)][self].merge({1, wrong});
  }
  CheckedDifferences& checked(CheckedEstimate estimate) { return check_estimates[int(estimate)]; }
  const CheckedDifferences& checked(CheckedEstimate estimate) const { return check_estimates[int(estimate)]; }
  void add_bake(const BakeCounters& counters) {
    bake_rays += counters.rays;
    time_bake += counters.seconds;
  }
  void add_bake(const Stats& other) {  // only the bake's cost, of work that was discarded
    add_bake(BakeCounters{other.bake_rays, other.time_bake});
  }
  void merge_counters(const Stats& other);  // adds rays, look-ups, checks and stage times
  std::string to_json() const;              // nested by the dots of the documented keys
};

}  // namespace fieldtrace
