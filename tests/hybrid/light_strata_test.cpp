// Strata of long and of hidden-sided lights.
#include "hybrid/light/light_strata.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/light/light_sampling.h"
#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::SceneMaker;

StrataGrid grid_of(ShapeKind kind, const Affine& to_world, bool flips = false) {
  SceneMaker s;
  const uint32_t lamp = s.instance(s.shape(kind), s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), to_world);
  s.scene.instances[lamp].flip_normals = flips;
  s.area_light(lamp, Rgb(1.0f));
  return strata_grid(make_lights(s.scene).lights[0]);
}

TEST(LightStrata, AreAboutAsWideAsHigh) {
  const Affine turn(Vec3(0.6f, 0, 0.8f), Vec3(0, 1, 0), Vec3(-0.8f, 0, 0.6f), Vec3(1, 2, 3));
  for (const ShapeKind kind : {ShapeKind::rectangle, ShapeKind::disk}) {
    for (float aspect = 0.033f; aspect < 31.0f; aspect *= 1.1f) {
      const Affine a(turn[0] * aspect, turn[1], turn[2], turn[3]);
      const StrataGrid grid = grid_of(kind, a);
      ASSERT_EQ(grid.columns * grid.rows, k_strata) << aspect;
      const float shape = aspect * float(grid.rows) / float(grid.columns);
      EXPECT_LT(std::max(shape, 1.0f / shape), 2.2f) << aspect;
      EXPECT_EQ(grid.columns == 4, std::abs(std::log2(aspect)) <= 1.0f) << aspect;
    }
    EXPECT_EQ(grid_of(kind, Affine(turn[0] * 40.0f, turn[1], turn[2], turn[3])).columns, 0);
    EXPECT_EQ(grid_of(kind, Affine(turn[0], turn[1] * 40.0f, turn[2], turn[3])).columns, 0);
  }
}

TEST(LightStrata, ThereAreNoneOfLightsThatAreSampledBehindThemselves) {
  EXPECT_EQ(grid_of(ShapeKind::sphere, test::scaling(Vec3(0.3f))).columns, 4);
  EXPECT_EQ(grid_of(ShapeKind::sphere, test::scaling(Vec3(0.3f)), /*flips=*/true).columns, 0);
  EXPECT_EQ(grid_of(ShapeKind::sphere, test::scaling(Vec3(0.3f, 0.3f, 0.1f))).columns, 0);
  EXPECT_EQ(grid_of(ShapeKind::cylinder, test::scaling(Vec3(0.3f))).columns, 0);
}

// Penumbrae along a light are as long as across, for their sizes.
TEST(LightStrata, OfALongLightArePenumbraeOfMonteCarlo) {
  for (const float aspect : {1.0f, 20.0f}) {
    SCOPED_TRACE(aspect);
    SceneMaker s;
    s.film(256, 256);
    s.scene.camera.to_world = look_at({0, -5, 5}, {0, 0, 0.3f}, {0, 0, 1});
    const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
    s.instance(s.mesh(make_supershape({.around = 96, .along = 48})), grey, test::translation(Vec3(0, 0, 1.2f)));
    const float x = 0.447f * std::sqrt(aspect), y = 0.447f / std::sqrt(aspect);
    const uint32_t lamp = s.instance(s.shape(ShapeKind::rectangle), grey,
                                     Affine(Vec3(x, 0, 0), Vec3(0, -y, 0), Vec3(0, 0, -1), Vec3(0, 0, 4)));
    s.area_light(lamp, Rgb(20.0f));
    RenderOptions o;
    o.threads = 2;
    o.spp = 64;
    o.tolerance = 0.1f;
    o.directions = 32, o.plane = 64;
    o.crop = Rect{104, 110, 48, 64};  // the object and its shadow
    const RenderResult estimate = render(s.scene, o);
    EXPECT_GT(estimate.stats.samples_by_strata, estimate.stats.samples / 10);
    o.method = Method::monte_carlo;
    o.light_samples = 16;
    const Image exact = render(s.scene, o).image;
    const float brightest = *std::max_element(exact.data.begin(), exact.data.end());
    const ImageDifference d = compare_images(estimate.image, exact);
    EXPECT_LT(d.rmse, 0.012 * double(brightest));
  }
}

}  // namespace
}  // namespace fieldtrace
