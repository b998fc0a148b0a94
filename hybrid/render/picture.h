// A picture to be made: its options, checked, and what follows from them and from the scene alone.
//
// Thread-safety: constant once made.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "core/camera/camera.h"
#include "core/trace/accel.h"
#include "field/file/field_cache.h"
#include "hybrid/film/checkpoint.h"
#include "hybrid/film/noise_forecast.h"
#include "hybrid/path/aovs.h"
#include "hybrid/render/render.h"
#include "hybrid/render/sky_stage.h"
#include "hybrid/render/sky_survey.h"
#include "hybrid/survey/light_noise.h"
#include "hybrid/survey/open_light_samples.h"
#include "hybrid/transport/transport.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

using Clock = std::chrono::steady_clock;

// Up to this many light samples a pixel their noise exceeds what estimates at the default tolerance err; with more the
// tolerance is less in proportion (docs/decisions/030-tolerance-by-noise.md).
inline constexpr double k_tolerated_light_samples = 128.0;

// A picture to be made: what all attempts at it share.
struct Picture {
  const Scene& scene;
  const RenderOptions& options;
  const RenderCallbacks& callbacks;
  int spp = 1;           // of a picture by rounds: what it is expected to need
  int most_samples = 1;  // of a pixel, in all
  std::vector<Aov> aovs;
  Rect window;
  TransportSettings settings;
  bool wants_fields = false;
  uint64_t field_memory = 0;  // the budget

  // Throws UsageError if options are out of range.
  Picture(const Scene& s, const RenderOptions& o, const RenderCallbacks& c);

  // Sets `spp`: to what --spp allows, or to what a resumed picture was begun with.
  void expect(double samples);
  void plan(int samples);
  // Sets how many rays leave a glossy surface, and with them what fits into one batch.
  void split_lobes(TransportSettings& s, int lobe_samples) const;
  bool by_rounds() const { return options.by_rounds(); }
  bool is_adaptive() const;           // whether lights that may be hidden get more light samples
  bool adapts_light_samples() const;  // the same, where there are area lights: others get no more
  // Light samples of each camera sample where lights may be hidden, at most.
  int most_open_samples() const;
  int open_sun_samples() const;  // the same of suns
  // Whether pixels have too few light samples for fields, with `open_samples` for each camera sample where lights may
  // be hidden.
  bool has_few_light_samples(int open_samples) const;
  // That of lights, which take `open_samples` light samples for each camera sample.
  float light_tolerance(int open_samples) const;
  bool stopped() const { return callbacks.stop && callbacks.stop->load(std::memory_order_relaxed); }
  // Of the whole film, so that fields, and with them pixels, are the same in every window; by rounds, where pixels
  // depend on it, of the window.
  Rect sampled_window() const;
  uint64_t film_samples() const;
  uint32_t survey_samples(double part = 1.0) const;  // few_samples_of() it, or of a part of its samples
  uint64_t rays_per_light() const { return film_samples() * uint64_t(options.light_samples); }
};

// The pixels of the film's crop window; of `requested` if given. Throws UsageError if that does not lie within.
Rect crop_window(const Film& film, const std::optional<Rect>& requested);

// The cache of fields and maps that the options name; null if they name none.
std::unique_ptr<FieldCache> open_cache(const Picture& picture);

// The noise of rays alone with these light samples of each camera sample, `open` where a light may be hidden.
struct RayNoise {
  int light_samples = 1, open_light_samples = 1;
  NoiseForecast noise;
};

// What is made from a picture's scene, once for all attempts.
struct Stage {
  const Accel& accel;
  CameraSampler camera;
  std::vector<ShapeTraits> traits;
  std::shared_ptr<const LightTable> lights;
  uint64_t address_space = k_no_address_limit;  // that fields may reserve
  std::unique_ptr<FieldCache> cache = nullptr;  // opened when it is first needed
  SkyStage sky = {};
  // What these surveys found, once they are made: whatever maps are requested, it is the same. The latter refers to
  // this stage, which must stay where it is.
  std::optional<SkySurvey> sky_survey = {};
  std::optional<LightNoise> light_noise = {};
  OpeningDevice* device = nullptr;  // null: the CPU
  FieldAccuracy accuracy = FieldAccuracy::usual;
  std::optional<NoiseByLightSamples> open_noise = {};  // of rays alone, once surveyed
  std::vector<RayNoise> ray_noise = {};  // of a picture by rounds; the first: with the light samples of the options
  // Light samples of each sequence with which the error of fields is surveyed: as many as rays take to the error, or in
  // the time.
  double survey_samples = 0.0;
  std::vector<SequencePair> ray_survey = {};         // what rays gave then, for every accuracy
  uint32_t ray_survey_samples = 0;                   // with so many camera samples of each sequence
  std::optional<Clock::time_point> deadline = {};    // of a picture with a time limit
  std::optional<Clock::time_point> survey_end = {};  // likewise: surveys have taken their share of it then
  PictureIdentity identity = {};                     // of a picture with checkpoints
  std::optional<Checkpoint> resumed = {};            // where the picture goes on

  bool uses_fields() const { return accuracy != FieldAccuracy::rays; }
  bool surveys_are_over() const { return survey_end && Clock::now() >= *survey_end; }
};

// The stage's cache, opened if it is not open yet; null if the options name none.
inline FieldCache* cache_of(const Picture& picture, Stage& stage) {
  if (!stage.cache) stage.cache = open_cache(picture);
  return stage.cache.get();
}

// Whether fields, for which surveys bake, are given up for the time that these took.
inline bool is_late(const Picture& picture, const Stage& stage) {
  return picture.wants_fields && stage.uses_fields() && !stage.resumed && stage.surveys_are_over();
}

// Whether a survey goes on. Both must outlive this.
inline std::function<bool()> while_surveys_may(const Picture& picture, const Stage& stage) {
  return [&] { return !picture.stopped() && !stage.surveys_are_over(); };
}

// The picture, for surveys of its noise by so many samples. Both must outlive it.
PictureSurvey picture_survey(const Picture& picture, const Stage& stage, uint32_t samples);

}  // namespace fieldtrace
