// Prefiltered radiance: what is filled in is read again, at every level and where nothing is known.

#include "field/maps/radiance_pyramids.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/simd/vec_lanes.h"
#include "field/maps/cell_radiance.hd.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

Rgb read(const RadianceView& view, int pyramid, float x, float y, float footprint) {
  return to_vec(scalar::read_radiance<float>(view, pyramid * view.bytes, x, y, footprint, true));
}

// Codes are steps of the root of radiance.
float code_error(float radiance, float most) { return (std::sqrt(radiance * most) + 0.001f * most) / 1000.0f; }

TEST(RadiancePyramids, HoldWhatTheyAreGiven) {
  TestRandom random(31);
  for (const int texels : {2, 8, 32}) {
    RadiancePyramids pyramids(texels, 3);
    EXPECT_EQ(pyramids.bytes(), RadiancePyramids::bytes_of(texels, 3));
    const float most = random.log_uniform(1e-6f, 1e6f);
    pyramids.set_most(most);
    std::vector<Rgb> values(size_t(texels) * size_t(texels));
    for (Rgb& v : values) v = Rgb(random.uniform(), random.uniform(), random.uniform()) * most;
    pyramids.fill(1, values, std::vector<uint8_t>(values.size(), 1));
    const RadianceView view = pyramids.view();
    Rgb mean(0.0f);
    for (size_t i = 0; i < values.size(); ++i) {
      mean += values[i] / float(values.size());
      const Rgb got = read(view, 1, float(i % size_t(texels)) + 0.5f, float(i / size_t(texels)) + 0.5f, 0.0f);
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(got[c], values[i][c], code_error(values[i][c], most));
      EXPECT_EQ(read(view, 0, 1.0f, 1.0f, 0.0f), Rgb(0.0f));  // not filled
    }
    // The last level has 2 x 2 texels; its middle is the mean of all.
    const Rgb middle = read(view, 1, 0.5f * float(texels), 0.5f * float(texels), 1e6f);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(middle[c], mean[c], code_error(mean[c], most));
  }
}

TEST(RadiancePyramids, UnknownTexelsHoldTheirSurroundings) {
  RadiancePyramids pyramids(16, 1);
  pyramids.set_most(2.0f);
  // Known in two columns, at the left and at the right.
  std::vector<Rgb> values(256, Rgb(9.0f));
  std::vector<uint8_t> is_known(256, 0);
  for (size_t y = 0; y < 16; ++y) {
    values[y * 16] = Rgb(1.0f), values[y * 16 + 15] = Rgb(2.0f);
    is_known[y * 16] = is_known[y * 16 + 15] = 1;
  }
  pyramids.fill(0, values, is_known);
  const RadianceView view = pyramids.view();
  EXPECT_NEAR(read(view, 0, 4.5f, 7.5f, 0.0f).x, 1.0f, 0.01f);
  EXPECT_NEAR(read(view, 0, 11.5f, 7.5f, 0.0f).x, 2.0f, 0.01f);
  EXPECT_NEAR(read(view, 0, 8.0f, 8.0f, 100.0f).x, 1.5f, 0.01f);
  // Outside the map: as at its edge.
  EXPECT_EQ(read(view, 0, -50.0f, 7.5f, 0.0f), read(view, 0, 0.0f, 7.5f, 0.0f));
}

TEST(RadiancePyramids, WithoutAnythingKnownAreBlack) {
  RadiancePyramids pyramids(4, 1);
  pyramids.set_most(1.0f);
  pyramids.fill(0, std::vector<Rgb>(16, Rgb(1.0f)), std::vector<uint8_t>(16, 0));
  EXPECT_EQ(read(pyramids.view(), 0, 2.0f, 2.0f, 0.0f), Rgb(0.0f));
}

}  // namespace
}  // namespace fieldtrace
