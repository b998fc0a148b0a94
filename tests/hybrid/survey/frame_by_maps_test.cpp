// Whether finer maps pay in a picture.
#include "hybrid/survey/frame_by_maps.h"

#include <gtest/gtest.h>

#include <cmath>

namespace fieldtrace {
namespace {

// Of a million rays; half of a light of mean square 1 is hidden.
FrameByMaps frame(double noise) { return {.rays = 1e6, .reads = 0.0, .noise = noise, .hidden = 0.5}; }

TEST(FrameByMaps, FinerOnesAreWorthMoreWhereLessNoiseIsLeft) {
  for (const int d : {16, 32, 64}) {
    double worth = frame(0.0).worth_of_finer(d, 1.0);
    for (const double noise : {1e-6, 1e-4, 1e-2, 1.0}) {
      const double less = frame(noise).worth_of_finer(d, 1.0);
      EXPECT_LT(less, worth) << d << " " << noise;
      EXPECT_GE(less, 0.0);
      worth = less;
    }
    EXPECT_LT(worth, 1e3) << d;  // of noise alone no maps take anything away
  }
}

// Without noise the time to an error falls as the error to the power of 4/3.
TEST(FrameByMaps, WithoutNoiseTheTimeFallsWithTheError) {
  constexpr double k_fall = 4.0;  // of the error, for twice the directions
  EXPECT_NEAR(frame(0.0).worth_of_finer(16, 1.0), 1e6 * (std::pow(k_fall, 4.0 / 3.0) - 1.0), 1.0);
}

TEST(FrameByMaps, FinerOnesAreWorthLessTheFinerTheyAre) {
  EXPECT_LT(frame(1e-4).worth_of_finer(32, 1.0), frame(1e-4).worth_of_finer(16, 1.0));
  EXPECT_LT(frame(1e-4).worth_of_finer(64, 1.0), frame(1e-4).worth_of_finer(32, 1.0));
}

TEST(FrameByMaps, ReadsCostWhatTheyTake) {
  FrameByMaps of_planes = frame(1e-4);
  const double worth = of_planes.worth_of_finer(16, 1.0);
  of_planes.reads = 1e5;
  EXPECT_NEAR(worth - of_planes.worth_of_finer(16, 1.0), (256.0 - 64.0) * 1e5 / 200.0, 1e-3);
  of_planes.reads = 1e7;
  EXPECT_LT(of_planes.worth_of_finer(16, 1.0), 0.0);
}

TEST(FrameByMaps, ALowToleranceWantsFinerOnes) {
  EXPECT_GT(frame(1e-3).worth_of_finer(32, 0.1), frame(1e-3).worth_of_finer(32, 1.0));
  EXPECT_EQ(frame(1e-3).worth_of_finer(32, 3.0), frame(1e-3).worth_of_finer(32, 1.0));
}

// An evenly black picture.
TEST(FrameByMaps, NothingHiddenIsWorthNothing) { EXPECT_EQ((FrameByMaps{.rays = 1e6}.worth_of_finer(16, 1.0)), 0.0); }

}  // namespace
}  // namespace fieldtrace
