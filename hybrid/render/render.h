// The renderer: one scene in, one picture and its statistics out, by Monte Carlo or by the hybrid method.
//
// The two methods differ in how light samples (hybrid/light/direct_light.h) and glossy rays
// (hybrid/render/glossy_stage.h) are answered. Determinism: for one scene, options and seed the picture is the same bit
// for bit for any thread count, instruction set and device, with or without a field cache, and in every crop window
// (scenes of more than k_most_candidates instances trace whole tiles for that, and count these rays). Where fields
// outgrow their memory the render restarts with less (hybrid/fields/field_set.h), and the picture depends on that
// memory and on the crop window, too. Thread-safety: render() may be called from several threads with different scenes.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/platform/error.h"
#include "core/scene/scene.h"
#include "core/simd/isa.h"
#include "field/file/keep.h"
#include "field/store/risk_classes.h"
#include "hybrid/film/noise_sums.h"
#include "hybrid/film/part.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace {

enum class Method { monte_carlo, hybrid };

// How the space of rays is cut into cells. In the thesis' chart, fields are baked completely and answer every shadow
// ray that meets them by its nearest cell: nothing certifies the answers, and only tolerance 0 traces exact rays
// instead.
enum class Chart { orthographic, thesis };

// Whether fields answer glossy rays by certified hits: for large meshes where enough rays pay for the bake (automatic),
// wherever possible (always), or never.
enum class FieldHits { automatic, always, never };
// What decides how many light samples a camera sample takes where something may hide the light: light_samples does, or
// a survey of the picture (hybrid/survey/open_light_samples.h). Automatic: adaptive for the hybrid at tolerances above
// 0, samples for Monte Carlo.
enum class LightEstimator { automatic, samples, adaptive };

// Limits at each shading point, and at each glossy hit.
inline constexpr int k_most_light_samples = 1 << 16;
inline constexpr int k_most_lobe_samples = 1 << 12;

struct RenderOptions {
  Method method = Method::hybrid;
  int spp = 0;                   // camera samples a pixel; 0: the scene file's sampler
  int light_samples = 1;         // shadow rays per light and hit
  int lobe_samples = 1;          // rays per glossy hit of the camera path
  std::optional<uint32_t> seed;  // default: the scene file's
  // [0, 1]; 0: every ray is traced, 1: every cell answers. Default: k_default_tolerance, for lights less where a pixel
  // has so many light samples that estimates would err more than noise (docs/decisions/030-tolerance-by-noise.md), for
  // skies more where it has few (docs/decisions/024-skies.md).
  std::optional<float> tolerance;
  Chart chart = Chart::orthographic;
  int directions = 0;              // D: 32, 64, 128, 256; 0: chosen from the scene. Thesis: M, 32, 64 or 128; 0: 64
  int plane = 0;                   // N: 64, 128, 256, 512; 0: chosen from the scene. Thesis: 0
  std::string field_cache;         // directory; empty: fields live in memory only
  uint64_t field_cache_limit = 0;  // bytes of field files in that directory; 0: no limit
  IfUnkept if_unkept = IfUnkept::warn;  // what field_cache cannot keep
  uint64_t field_memory = 0;            // bytes of all fields in memory; 0: half of the machine's memory
  int threads = 0;                      // 0: all hardware threads
  Isa isa = Isa::automatic;
  std::string device = "cpu";              // that answers shadow rays; others: visibility_device.h
  uint64_t device_memory = 0;              // bytes of its memory that fields may take there; 0: all
  uint64_t wave_samples = k_wave_samples;  // test aid: light samples that its waves are made from, at least
  std::optional<Rect> crop;                // within the film's crop window
  std::optional<int> max_depth;            // overrides the integrator's
  bool check = false;                      // also trace an exact ray for every field's answer, and count disagreements
  bool force_undecided = false;            // test aid: look up, then treat every cell as undecided
  bool whole_lights = true;                // let fields answer whole lights first; false: single rays only
  bool leave_to_rays = true;               // leave objects to exact rays whose fields do not pay, by a survey
  FieldHits field_hits = FieldHits::automatic;
  LightEstimator light_estimator = LightEstimator::automatic;
  std::vector<std::string> aovs;   // albedo normal depth position visibility exact object ao
  float ao_distance = k_infinity;  // world units, > 0: farther surfaces do not occlude in the layer ao
  // Pictures by rounds (render_rounds.h); `spp`, unless 0, is then the most samples of a pixel.
  float target_error = 0.0f;  // > 0: the picture's error at which it is finished, by error_measure
  ErrorMeasure error_measure = ErrorMeasure::absolute;
  float time_limit = 0.0f;  // > 0: seconds from the beginning of render()
  // File that keeps what has been rendered, written every checkpoint_seconds, after an interrupt and at the end; and
  // one to go on from. Empty: none.
  std::string checkpoint, resume;
  double checkpoint_seconds = 60.0;
  std::optional<Slice> slice;  // only these tiles; not for pictures by rounds or with checkpoints

  bool keeps_sums() const { return by_rounds() || !checkpoint.empty() || !resume.empty(); }
  bool by_rounds() const { return target_error > 0.0f || time_limit > 0.0f; }
  float base_tolerance() const { return tolerance.value_or(k_default_tolerance); }
  // Whether fields and maps are made whatever they cost.
  bool at_any_cost() const { return directions > 0 || plane > 0 || !leave_to_rays; }
};

struct RenderCallbacks {
  // Called from one thread at a time with the share of the work done, in [0, 1], and the current stage.
  std::function<void(float share, const char* stage)> progress;
  WarningSink warning;
  // Called by any thread, by several at once, when pixels have new values: R, G, B of `tile` row by row; its x and y
  // count from the picture's corner. Those of pictures by rounds come again and again.
  std::function<void(const Rect& tile, std::span<const Rgb> pixels)> tile = {};
  const std::atomic<bool>* stop = nullptr;  // set to end early; finished tiles are kept
};

struct RenderResult {
  Image image;  // R, G, B and the AOV channels; width and height of the crop window; unfinished tiles are 0
  Stats stats;
  bool interrupted = false;
  bool has_samples = false;  // of any pixel
  std::optional<Part> part;  // of a slice: what to write with the image
};

// Slices: each makes the decisions that the whole picture makes, from the whole picture, so that its tiles are those of
// the whole bit for bit. One exception is an Error: fields of a slice that outgrow their memory.
//
// Throws Error for a scene that cannot be rendered, UsageError for contradictory or out-of-range options.
RenderResult render(const Scene& scene, const RenderOptions& options, const RenderCallbacks& callbacks = {});

}  // namespace fieldtrace
