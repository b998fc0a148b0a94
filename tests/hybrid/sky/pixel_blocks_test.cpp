// Irradiance fitted within blocks of pixels.
#include "hybrid/light/pixel_blocks.h"

#include <gtest/gtest.h>

#include <functional>
#include <random>

namespace fieldtrace::test {
namespace {

using Function = std::function<float(int x, int y)>;

// A tile of one surface: pixels, points and groups.
struct Surface {
  std::vector<PixelPosition> pixels;
  ShadingPointBatch points;
  std::vector<uint32_t> groups;

  explicit Surface(const Rect& tile) : Surface(tile_pixels(tile, true)) {}
  explicit Surface(std::vector<PixelPosition> all) : pixels(std::move(all)), groups(pixels.size(), 0) {
    points.resize(pixels.size());
    for (size_t i = 0; i < pixels.size(); ++i) set(i, Vec3(float(pixels[i].x), float(pixels[i].y), 0.0f), {0, 0, 1});
  }
  void set(size_t i, const Vec3& p, const Vec3& n) {
    points.px[i] = p.x, points.py[i] = p.y, points.pz[i] = p.z;
    points.sx[i] = points.gx[i] = n.x, points.sy[i] = points.gy[i] = n.y, points.sz[i] = points.gz[i] = n.z;
  }
};

struct Result {
  std::vector<SkyArrival> arrivals;
  std::vector<uint8_t> fitted;
  std::vector<int> asked;  // how often

  size_t asked_count() const { return size_t(std::count(asked.begin(), asked.end(), 1)); }
};

Result gather(const Surface& surface, const Function& f, float tolerance) {
  const size_t count = surface.pixels.size();
  Result result{std::vector<SkyArrival>(count), std::vector<uint8_t>(count), std::vector<int>(count)};
  PixelBlocks blocks;
  std::vector<uint32_t> wanted;
  blocks.find(surface.points, surface.pixels, surface.groups, k_infinity, wanted);
  for (int round = 0; !wanted.empty(); ++round) {
    EXPECT_LT(round, 4);
    for (const uint32_t i : wanted) {
      ++result.asked[i];
      result.arrivals[i].values.fill(f(surface.pixels[i].x, surface.pixels[i].y));
    }
    blocks.refine(tolerance, result.arrivals, result.fitted, wanted);
  }
  return result;
}

float value(const Result& r, size_t i) { return r.arrivals[i].values[0]; }

// Whatever is gathered: each pixel is asked for once or fitted.
void expect_complete(const Surface& surface, const Result& r, const Function& f) {
  for (size_t i = 0; i < surface.pixels.size(); ++i) {
    ASSERT_EQ(r.asked[i] + int(r.fitted[i]), 1) << surface.pixels[i].x << " " << surface.pixels[i].y;
    if (r.asked[i]) {
      ASSERT_EQ(value(r, i), f(surface.pixels[i].x, surface.pixels[i].y));
    }
  }
}

TEST(PixelBlocks, LinearFunctionsAreAskedForAtSixPixelsOfABlock) {
  const Surface surface(Rect{16, 40, 32, 24});
  const Function f = [](int x, int y) { return 0.2f + 0.003f * float(x) + 0.005f * float(y); };
  const Result r = gather(surface, f, 1e-4f);
  expect_complete(surface, r, f);
  EXPECT_EQ(r.asked_count(), surface.pixels.size() / 64 * k_block_samples);
  for (size_t i = 0; i < surface.pixels.size(); ++i) {
    EXPECT_NEAR(value(r, i), f(surface.pixels[i].x, surface.pixels[i].y), 1e-5f);
  }
}

// Of functions of second degree.
TEST(PixelBlocks, CurvedFunctionsAreFittedWithinThreeTolerances) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  size_t fitted = 0, asked = 0;
  for (int round = 0; round < 200; ++round) {
    const Surface surface(Rect{0, 0, 16, 16});
    const float bend = 0.004f * uniform(random), bow = 0.004f * uniform(random), skew = 0.004f * uniform(random),
                slope = 0.02f * uniform(random);
    const Function f = [=](int x, int y) {
      return 5.0f + slope * float(x) + bend * float(x * x) + bow * float(y * y) + skew * float(x * y);
    };
    const Result r = gather(surface, f, 0.01f);
    expect_complete(surface, r, f);
    for (size_t i = 0; i < surface.pixels.size(); ++i) {
      EXPECT_NEAR(value(r, i), f(surface.pixels[i].x, surface.pixels[i].y), 0.03f);
      (r.fitted[i] ? fitted : asked) += 1;
    }
  }
  EXPECT_GT(fitted, asked / 10);
  EXPECT_GT(asked, fitted / 10);
}

TEST(PixelBlocks, NoiseIsAskedForEverywhere) {
  const Surface surface(Rect{0, 0, 32, 32});
  std::mt19937 random(1);
  std::vector<float> noise(32 * 32);
  for (float& v : noise) v = std::uniform_real_distribution<float>()(random);
  const Function f = [&](int x, int y) { return noise[size_t(32 * y + x)]; };
  const Result r = gather(surface, f, 0.005f);
  expect_complete(surface, r, f);
  EXPECT_EQ(r.asked_count(), surface.pixels.size());
}

// Values of one surface say nothing about another, nor about what lies beyond a crease or a step.
TEST(PixelBlocks, NothingIsFittedAcrossEdges) {
  const Function f = [](int, int) { return 0.5f; };  // what is fitted cannot be told from what is asked
  const auto crossing = [](const PixelPosition& p) { return 3 * p.x + 5 * p.y > 100; };
  const auto expect_unfitted = [&](const Surface& surface, const char* what) {
    SCOPED_TRACE(what);
    const Result r = gather(surface, f, 0.005f);
    expect_complete(surface, r, f);
    for (size_t i = 0; i < surface.pixels.size(); ++i) {
      const PixelPosition& p = surface.pixels[i];
      bool divided = false;  // its block of 4 x 4
      for (int y = p.y / 4 * 4; y < p.y / 4 * 4 + 4; ++y) {
        for (int x = p.x / 4 * 4; x < p.x / 4 * 4 + 4; ++x) divided = divided || crossing({x, y}) != crossing(p);
      }
      if (divided) {
        EXPECT_TRUE(r.asked[i]) << p.x << " " << p.y;
      }
    }
    EXPECT_LT(r.asked_count(), surface.pixels.size());
  };
  Surface groups(Rect{0, 0, 32, 32}), none = groups, crease = groups, step = groups;
  for (size_t i = 0; i < groups.pixels.size(); ++i) {
    const PixelPosition& p = groups.pixels[i];
    if (!crossing(p)) continue;
    groups.groups[i] = 7;
    none.groups[i] = k_none;
    crease.set(i, Vec3(float(p.x), float(p.y), 0.0f), glm::normalize(Vec3(2.0f, 0.0f, 1.0f)));
    step.set(i, Vec3(float(p.x), float(p.y), 20.0f), {0, 0, 1});
  }
  expect_unfitted(groups, "groups");
  expect_unfitted(none, "none");
  expect_unfitted(crease, "crease");
  expect_unfitted(step, "step");
}

// Tiles at the film's edges, pixels of one colour of a chessboard, single pixels, pixels with several surfaces.
TEST(PixelBlocks, IncompleteBlocksAreCompleted) {
  const Function f = [](int x, int y) { return 1.0f + 0.01f * float(x - y); };
  std::mt19937 random(3);
  std::vector<std::vector<PixelPosition>> cases = {{{5, 9}}, tile_pixels({3, 5, 11, 13}, true), tile_pixels({8, 8, 1, 40}, true)};
  std::vector<PixelPosition> chessboard, some, twice;
  for (const PixelPosition& p : tile_pixels({0, 0, 32, 32}, true)) {
    if ((p.x + p.y) % 2) chessboard.push_back(p);
    if (random() % 3) some.push_back(p);
    twice.insert(twice.end(), p.x == 9 ? 2 : 1, p);
  }
  cases.insert(cases.end(), {chessboard, some, twice});
  for (const auto& pixels : cases) {
    const Surface surface(pixels);
    const Result r = gather(surface, f, 0.005f);
    expect_complete(surface, r, f);
    for (size_t i = 0; i < pixels.size(); ++i) EXPECT_NEAR(value(r, i), f(pixels[i].x, pixels[i].y), 1e-4f);
  }
  EXPECT_LT(gather(Surface(chessboard), f, 0.005f).asked_count(), chessboard.size() / 4);
}

}  // namespace
}  // namespace fieldtrace::test
