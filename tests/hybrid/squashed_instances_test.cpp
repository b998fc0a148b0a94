// Soft shadows of instances that do not keep angles, and of instances that overlap: no further from the truth than
// Monte Carlo's with as many light samples, although strata are filtered.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

constexpr int k_size = 96;

// Knots over a floor under a light of about 20 degrees; `shapes`: their linear maps, `at`: their places.
Scene knots(const std::vector<Mat3>& shapes, const std::vector<Vec3>& at) {
  test::SceneMaker s;
  s.film(k_size, k_size);
  s.scene.sample_count = 1;
  s.scene.camera.to_world = test::look_at({2.5f, -6, 3}, {0, 0, 0.3f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 35.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  const uint32_t knot = s.mesh(make_knot({.along = 256, .around = 24}));
  for (size_t i = 0; i < shapes.size(); ++i) {
    s.instance(knot, grey, Affine(shapes[i][0], shapes[i][1], shapes[i][2], at[i]));
  }
  s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
  Affine place = test::scaling(Vec3(0.8f));
  place[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, place), Rgb(80.0f));
  return s.scene;
}

// Scales by `factor` along `axis`.
Mat3 squash(const Vec3& axis, float factor) {
  const Vec3 n = glm::normalize(axis);
  return Mat3(1.0f) + (factor - 1.0f) * glm::outerProduct(n, n);
}

struct Errors {
  double ratio = 0.0;     // RMSE with fields over Monte Carlo's
  double bias = 0.0;      // of the picture with fields, relative to its mean
  double answered = 0.0;  // share of strata that fields answer
};

Errors errors_of(const Scene& scene, const Image& truth, int light_samples) {
  RenderOptions o;
  o.light_samples = light_samples;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  const RenderResult fields = render(scene, o);
  o.method = Method::monte_carlo;
  const ImageDifference by_fields = compare_images(fields.image, truth);
  const ImageDifference by_samples = compare_images(render(scene, o).image, truth);
  const Stats& s = fields.stats;
  return {by_fields.rmse / by_samples.rmse, by_fields.bias,
          double(s.strata - s.strata_refused) / double(std::max<uint64_t>(s.strata, 1))};
}

Image truth_of(const Scene& scene) {
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.light_samples = 1024;
  o.threads = 2;
  return render(scene, o).image;
}

// The aim is 1.1. A ratio of two RMSEs over n independent pixels of normal errors varies by 1 / sqrt(n); a few hundred
// of a picture's pixels hold most of its error.
const double k_most_ratio = 1.1 * (1.0 + 3.0 / std::sqrt(400.0));

struct Squash {
  std::string name;
  Mat3 shape;
  bool edge_on = false;  // as the light sees it
};

TEST(SquashedInstances, ErrNoMoreThanMonteCarlo) {
  const Mat3 sheared(Vec3(1, 0, 0.2f), Vec3(0.8f, 1, 0), Vec3(0.3f, -0.5f, 1));
  const std::vector<Squash> squashes = {{"a tenth, upwards", squash({0, 0, 1}, 0.1f)},
                                        {"a hundredth, towards the camera", squash({0, 1, 0}, 0.01f)},
                                        {"a ten-thousandth, aslant", squash({0.3f, 1, 0.5f}, 1e-4f), true},
                                        {"mirrored, aslant", squash({1, -0.4f, 0.6f}, -0.03f)},
                                        {"sheared and squashed", sheared * squash({0, 1, 0.2f}, 0.02f), true},
                                        {"a rod", squash({0, 1, 0}, 0.1f) * squash({1, 0, 0}, 0.1f)}};
  for (const Squash& s : squashes) {
    const Scene scene = knots({s.shape}, {{0, 0, 1}});
    const Image truth = truth_of(scene);
    for (const int samples : {16, 64}) {
      const Errors e = errors_of(scene, truth, samples);
      EXPECT_LE(e.ratio, k_most_ratio) << s.name << ", " << samples << " light samples";
      // All but instances that the light sees edge-on.
      EXPECT_GE(e.answered, s.edge_on ? 0.3 : 0.8) << s.name << ", " << samples << " light samples";
    }
  }
}

// Of twelve instances in the same place none adds a shadow. The product of their shares is too dark.
TEST(SquashedInstances, OverlappingInstancesErrNoMoreThanMonteCarlo) {
  for (const float step : {0.0f, 0.02f}) {
    const size_t count = step == 0.0f ? 12 : 4;
    std::vector<Vec3> at;
    for (size_t i = 0; i < count; ++i) at.push_back(Vec3(float(i) * step, float(i) * step, 1.0f));
    const Scene scene = knots(std::vector<Mat3>(count, Mat3(1.0f)), at);
    const Image truth = truth_of(scene);
    for (const int samples : {16, 64}) {
      const Errors e = errors_of(scene, truth, samples);
      EXPECT_LE(e.ratio, k_most_ratio) << step << ", " << samples << " light samples";
      // Monte Carlo's own bias is far below a thousandth; the product's is several.
      EXPECT_LE(std::abs(e.bias), 0.001) << step << ", " << samples << " light samples";
    }
  }
}

// Instances whose balls lie apart go on multiplying their shares.
TEST(SquashedInstances, InstancesApartAreAnsweredTogether) {
  const Mat3 small(0.35f);
  const Scene scene = knots({small, small}, {{0, 0, 1}, {0.75f, -0.75f, 2.1f}});
  const Errors e = errors_of(scene, truth_of(scene), 64);
  EXPECT_LE(e.ratio, k_most_ratio);
  EXPECT_GE(e.answered, 0.8);
}

}  // namespace
}  // namespace fieldtrace
