// A scene as surveys of noise see it.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "core/light/light_sampling.h"
#include "core/trace/accel.h"
#include "hybrid/survey/noise_survey.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace::test {

struct SurveyedScene {
  const Scene& scene;
  TransportSettings settings;
  Accel accel{scene};
  std::vector<ShapeTraits> traits = shape_traits(scene);
  std::shared_ptr<const LightTable> lights = std::make_shared<const LightTable>(make_lights(scene));

  // What this refers to must outlive it.
  PictureSurvey with(GoesOn goes_on = [] { return true; }) const {
    return {scene, accel, traits, lights, settings, scene.film.crop, 1, ErrorMeasure::absolute, std::move(goes_on)};
  }
};

// Calls `check` with how often surveys that ask `all` times whether they go on may do so, if they are cut short.
template <typename Check>
void for_each_cut(int all, const Check& check) {
  for (const int most : {0, 1, all / 4, all / 2, 3 * all / 4, all - 1}) check(most);
}

}  // namespace fieldtrace::test
