// Makes the direction maps by which a picture's sky and its layer `ao` are answered. Thread-safety: called
// by one thread; reading and baking are parallel.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/trace/accel.h"
#include "field/file/field_cache.h"
#include "hybrid/render/render.h"
#include "hybrid/sky/sky.h"
#include "hybrid/survey/frame_by_maps.h"

namespace fieldtrace {

// What answers for a picture's skies; null members: rays do.
struct SkyStage {
  bool can_be_finer = false;  // for light there would be more directions, had fewer not been requested
  std::unique_ptr<SkyMaps> maps;
  std::unique_ptr<Sky> light;             // of the scene's emitters
  std::unique_ptr<Sky> occlusion;         // of the layer `ao`
  std::vector<FieldIdentity> identities;  // of the maps' files
  // The share of Monte Carlo's noise that is left where light has none, if a survey has found that.
  std::optional<double> noise_left;
};

// Lines that fine maps may have for each ray that they replace, where no survey tells what they gain, and all maps
// without a sky.
inline constexpr uint64_t k_usual_maps_gain = 2, k_bounce_maps_gain = 1;
// What a frame takes where maps answer, without their making, in Monte Carlo's time: what they gain must be more.
inline constexpr double k_time_by_maps = 1.2;
inline constexpr int k_coarse_directions = 16;

struct SkyRequest {
  // Rays of the whole film that maps would spare Monte Carlo; 0: not wanted.
  uint64_t light_rays = 0, occlusion_rays = 0;
  uint64_t light_cost = 0;                // rays that maps for light may cost at most
  std::optional<double> noise_left;       // SkyStage's
  std::optional<FrameByMaps> frame;       // by maps for light; none: not surveyed
  float occlusion_distance = k_infinity;  // of the layer `ao`
  // Light samples of a pixel; the most that there may be where their number tells nothing of the noise.
  uint64_t samples = 0;
  uint64_t most_bytes = 0;     // that maps may take
  bool bounces = false;        // maps are to know light from surface to surface, too
  uint64_t bounce_rays = 0;    // what that costs with k_coarse_directions
  std::vector<uint8_t> sends;  // by instance, whether its diffuse light would be known; empty if none is
  std::vector<Vec3> seen;      // for that: points that the camera sees
  bool coarse = false;         // maps for light have no more directions than for few samples, and their tolerance
};

// Whether the scene has emitters that surround it.
bool has_sky(const Scene& scene);

// Whether maps may answer: where the tolerance admits estimates.
bool admits_maps(const RenderOptions& options);

// The largest part of the sphere that is cut out of a sky (SkyRadiance) where a pixel has so many light samples and
// maps D = `directions`: samples of it have noise, which falls with their number; cells blur its shadows, the less the
// more they are.
double largest_source(uint64_t samples, int directions);

// Opens the cache that maps are kept in; null: there is none.
using CacheOpener = std::function<FieldCache*()>;

// Makes nothing where the tolerance admits no estimates, or where maps would cost too much memory, or too many rays;
// and nothing for the layer `ao` within less than the radius of most objects (unless a resolution of fields is
// requested, or nothing is to be left to rays). Reads the maps that the cache holds, bakes the rest and stores it
// there; `cache` is called only if there are maps to make. What cannot be stored causes a warning. Maps are incomplete
// if `callbacks.stop` was set meanwhile.
SkyStage make_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                  const RenderOptions& options, const SkyRequest& request, const CacheOpener& cache,
                  const RenderCallbacks& callbacks, Stats& stats);

}  // namespace fieldtrace
