// Pictures of both methods against kept references, tested statistically: Monte Carlo must agree up to its noise, the
// hybrid up to its noise and what its fields may add. On failure the picture, the reference, their difference and the
// p-values are written; the message names the files.

#include <gtest/gtest.h>

#include <algorithm>

#include "hybrid/render/sky_stage.h"
#include "tests/support/reference_scenes.h"

namespace fieldtrace {
namespace {

using test::Agreement;
using test::AgreementOptions;
using test::ReferenceScene;
using test::Renders;
using test::SampledPicture;

constexpr uint32_t k_first_seed = 1;
// That any picture of this file is refused although nothing is wrong.
constexpr double k_family_level = 0.01;

AgreementOptions options_for(Method method, const SampledPicture& reference, bool under_sky) {
  AgreementOptions o;
  o.level = k_family_level;
  o.comparisons = 2 * int(test::reference_scenes().size());
  o.same_law = method == Method::monte_carlo;
  if (method == Method::hybrid) o.allowance = test::field_allowance(reference, under_sky);
  return o;
}

std::string evidence(const std::string& name, const Renders& renders, const SampledPicture& reference,
                     const Agreement& found) {
  std::string message = found.summary();
  for (const std::string& path :
       test::write_evidence(FIELDTRACE_EVIDENCE_DIR, name, test::sampled_picture(renders.images), reference, found)) {
    message += "\n  " + path;
  }
  return message;
}

class ReferenceImage : public testing::TestWithParam<const char*> {
 protected:
  const ReferenceScene& description_ = test::reference_scene(GetParam());
  const Scene scene_ = test::load_reference_scene(description_);
  const SampledPicture reference_ = test::read_reference(test::reference_path(description_));

  Renders check(Method method, const char* method_name) const {
    Renders renders = render_reference_scene(scene_, description_, method, description_.renders, k_first_seed);
    const Agreement found = agreement(renders.images, reference_, options_for(method, reference_, has_sky(scene_)));
    RecordProperty("agreement", found.summary());  // in the file of --gtest_output
    EXPECT_TRUE(found.passed) << evidence(std::string(GetParam()) + "." + method_name, renders, reference_, found);
    return renders;
  }
};

TEST_P(ReferenceImage, MonteCarloAgrees) { check(Method::monte_carlo, "montecarlo"); }

TEST_P(ReferenceImage, HybridAgrees) {
  const Stats stats = check(Method::hybrid, "hybrid").last;
  // Fields take part: else this would be Monte Carlo's test once more.
  if (std::string(GetParam()) == "glossy") {
    EXPECT_LT(double(stats.rays_glossy_exact), 0.5 * double(stats.rays_glossy));
  } else {
    EXPECT_LT(stats.exact_fraction(), 0.9);
  }
}

std::vector<const char*> names() {
  std::vector<const char*> out;
  for (const ReferenceScene& s : test::reference_scenes()) out.push_back(s.name);
  return out;
}

// That the tests above would see these.
class ReferenceImageSees : public testing::TestWithParam<Method> {
 protected:
  Agreement found(const std::vector<Image>& images) const {
    return agreement(images, reference_, options_for(GetParam(), reference_, false));
  }
  std::vector<Image> images(const Scene& scene) const {
    return render_reference_scene(scene, description_, GetParam(), description_.renders, k_first_seed).images;
  }

  const ReferenceScene& description_ = test::reference_scene("floor");
  Scene scene_ = test::load_reference_scene(description_);
  const SampledPicture reference_ = test::read_reference(test::reference_path(description_));
};

TEST_P(ReferenceImageSees, ALightScaledByTwoPercent) {
  for (Emitter& emitter : scene_.emitters) emitter.value *= 1.02f;
  const Agreement a = found(images(scene_));
  EXPECT_FALSE(a.passed) << a.summary();
  EXPECT_NEAR(a.mean_difference, 0.02, 0.002);
}

TEST_P(ReferenceImageSees, AShiftByAPixel) {
  std::vector<Image> shifted = images(scene_);
  for (Image& image : shifted) std::rotate(image.data.begin(), image.data.begin() + 3, image.data.end());
  const Agreement a = found(shifted);
  EXPECT_FALSE(a.passed) << a.summary();
  EXPECT_GT(a.refused_pixels, 100);
}

TEST_P(ReferenceImageSees, ALightMovedByItsRadius) {
  Instance& lamp = scene_.instances[scene_.emitters[0].instance];
  const float radius = glm::length(lamp.to_world[0]);
  lamp.to_world[3].x += radius;
  lamp.to_object[3].x -= 1.0f;
  const Agreement a = found(images(scene_));
  EXPECT_FALSE(a.passed) << a.summary();
}

INSTANTIATE_TEST_SUITE_P(Methods, ReferenceImageSees, testing::Values(Method::monte_carlo, Method::hybrid),
                         [](const auto& tested) {
                           return std::string(tested.param == Method::hybrid ? "hybrid" : "montecarlo");
                         });

// Cells that certify nothing answer too.
TEST(ReferenceImageSeesFields, ThatAnswerEverything) {
  const ReferenceScene& description = test::reference_scene("floor");
  const SampledPicture reference = test::read_reference(test::reference_path(description));
  const Renders renders = render_reference_scene(test::load_reference_scene(description), description, Method::hybrid,
                                                 description.renders, k_first_seed, 1.0f);
  const Agreement a = agreement(renders.images, reference, options_for(Method::hybrid, reference, false));
  EXPECT_FALSE(a.passed) << a.summary();
}

INSTANTIATE_TEST_SUITE_P(Scenes, ReferenceImage, testing::ValuesIn(names()),
                         [](const auto& tested) { return std::string(tested.param); });

}  // namespace
}  // namespace fieldtrace
