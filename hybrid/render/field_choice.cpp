#include "hybrid/render/field_choice.h"

#include <algorithm>
#include <cmath>

#include "hybrid/light/direct_light.h"
#include "hybrid/render/field_survey.h"
#include "hybrid/survey/open_light_samples.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Light samples of each pixel that a survey takes at most.
constexpr int64_t k_most_survey_samples = 64;

// Where every cell answers, or all are undecided by request, there is nothing to survey.
bool wants_survey(const Picture& picture, const FieldSet& fields) {
  const RenderOptions& options = picture.options;
  return fields.answers_shadows() && options.leave_to_rays && !options.force_undecided &&
         options.base_tolerance() < 1.0f;
}

// Surveys the picture with `light_samples` from one point of each pixel, as clusters will ask for them together.
FieldSurvey survey_picture(const Picture& picture, const Stage& stage, const std::vector<Field*>& fields,
                           std::vector<uint8_t> self_to_rays, float tolerance, TransportSettings settings,
                           int light_samples, Stats& stats) {
  const RenderOptions& options = picture.options;
  AnswererSettings counting{picture.settings.isa, tolerance, false, false, options.whole_lights};
  counting.count_uses = true;
  counting.self_to_rays = std::move(self_to_rays);
  const ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, fields, counting);
  settings.light_samples = light_samples;
  settings.first_hits = false;
  const TransportContext context(picture.scene, stage.accel, stage.camera, answerer, settings, stage.lights);
  const double repeats = double(picture.spp) * double(options.light_samples) / double(light_samples);
  FieldSurvey survey =
      survey_fields(context, crop_window(picture.scene.film, {}), repeats, while_surveys_may(picture, stage));
  stats.survey_rays += survey.stats.rays_exact;
  stats.add_bake(survey.stats);
  return survey;
}

}  // namespace

TransportSettings settings_for(const Picture& picture, const FieldSet& fields, float tolerance) {
  TransportSettings s = picture.settings;
  s.tolerance = tolerance;
  const RenderOptions& options = picture.options;
  const std::vector<Field*> answering = fields.pointers();
  s.estimates = options.whole_lights && !options.force_undecided &&
                std::any_of(answering.begin(), answering.end(), [](const Field* f) { return f != nullptr; });
  return s;
}

bool choose_light_samples(const Picture& picture, Stage& stage, int& open_samples, Stats& stats) {
  open_samples = picture.options.light_samples;
  if (!picture.adapts_light_samples()) return true;
  if (!stage.open_noise) {
    // What maps leave of the noise needs fewer samples than a picture by rays was expected to.
    const double left = picture.by_rounds() ? stage.sky.noise_left.value_or(1.0) : 1.0;
    const uint32_t samples = picture.survey_samples(std::pow(left, 1.0 / k_edge_decay));
    const PictureSurvey survey = picture_survey(picture, stage, samples);
    const NoiseByLightSamples found = noise_by_light_samples(survey, stats);
    // Where rays answer and time is short, there are no more light samples than elsewhere.
    if (!survey.goes_on()) return !picture.stopped() && !is_late(picture, stage);
    stage.open_noise = found;
  }
  NoiseByLightSamples noise = *stage.open_noise;
  // Of skies maps take it away, and what stays is at most the share of one sample.
  if (stage.sky.noise_left) noise.rest = std::min(noise.rest, *stage.sky.noise_left * (noise.light + noise.rest));
  open_samples = noise.best(open_samples);
  return true;
}

bool leave_unpaid(const Picture& picture, const Stage& stage, FieldSet& fields, int open_samples, Stats& stats) {
  if (!wants_survey(picture, fields) || !picture.options.whole_lights) return true;
  if (picture.has_few_light_samples(open_samples)) {
    fields.leave_all();
    return true;
  }
  TransportSettings settings = picture.settings;
  settings.pixel_samples = k_fewest_cone_samples;  // points are tested one by one
  FieldSurvey survey = survey_picture(picture, stage, {}, {}, picture.options.base_tolerance(), settings, 1, stats);
  if (survey.interrupted) return !picture.stopped() && !is_late(picture, stage);
  survey.scale *= double(open_samples) / double(picture.options.light_samples);
  fields.leave_unpaid(survey);
  return true;
}

bool leave_undecided(const Picture& picture, const Stage& stage, FieldSet& fields, float tolerance, Stats& stats) {
  if (!wants_survey(picture, fields)) return true;
  const int64_t of_pixel = int64_t(picture.spp) * picture.options.light_samples;
  TransportSettings settings = settings_for(picture, fields, tolerance);
  settings.pixel_samples = 1;
  const FieldSurvey survey = survey_picture(picture, stage, fields.pointers(), fields.self_to_rays(), tolerance,
                                            settings, int(std::min<int64_t>(of_pixel, k_most_survey_samples)), stats);
  if (survey.interrupted) return false;
  fields.leave_undecided(survey);
  return true;
}

}  // namespace fieldtrace
