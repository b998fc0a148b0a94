// Queries, changes and releases of one scene from many threads at once; every function by itself: api_misuse_test.cpp.
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "tests/support/api_scene.h"

namespace fieldtrace {
namespace {

using test::ApiScene;

FTError occluded(FTScene scene, const float* origins, const float* directions, const float* t_max, size_t count,
                 uint8_t* results) {
  return ftOccluded(scene, origins, 0, directions, 0, t_max, 0, nullptr, 0, count, results, 0);
}

// Every thread asks while one moves instances and another releases.
TEST(ApiThreads, AskCommitAndReleaseAtOnce) {
  const std::pair<FTDevice, FTScene> handles = ApiScene().take();
  const FTDevice device = handles.first;
  const FTScene scene = handles.second;
  std::vector<std::thread> threads;
  for (int k = 0; k < 8; ++k) {
    ASSERT_EQ(ftRetainScene(scene), FT_ERROR_NONE);
    threads.emplace_back([=] {
      std::vector<float> o(300), d(300);
      for (size_t i = 0; i < 300; ++i) o[i] = float(i % 7) - 3.0f, d[i] = float((i * 5 + size_t(k)) % 11) - 4.5f;
      std::vector<uint8_t> results(100), status(100);
      for (int round = 0; round < 8; ++round) {
        if (k == 0) {
          const float moved[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.1f * float(round), 1.5f, 0};
          EXPECT_EQ(ftSetInstanceTransform(scene, 0, moved), FT_ERROR_NONE);
          EXPECT_EQ(ftCommitScene(scene), FT_ERROR_NONE);
        }
        EXPECT_EQ(occluded(scene, o.data(), d.data(), nullptr, 100, results.data()), FT_ERROR_NONE);
        EXPECT_EQ(ftNearest(scene, 0.05f, o.data(), 0, d.data(), 0, nullptr, 0, nullptr, 0, 100, status.data(), 0,
                            nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0),
                  FT_ERROR_NONE);
        EXPECT_EQ(ftSetSceneInt(scene, "no such", k), FT_ERROR_INVALID_ARGUMENT);
        EXPECT_EQ(ftGetDeviceError(device, nullptr), FT_ERROR_INVALID_ARGUMENT);
      }
      EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
    });
  }
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_INVALID_ARGUMENT);  // gone
  EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
}

// The last reference goes while calls are under way: they end as if it had stayed.
TEST(ApiThreads, ReleasedWhileInUse) {
  const std::pair<FTDevice, FTScene> handles = ApiScene().take();
  const FTDevice device = handles.first;
  const FTScene scene = handles.second;
  std::vector<std::thread> threads;
  for (int k = 0; k < 7; ++k) {
    threads.emplace_back([=] {
      const std::vector<float> o(3000, 0.3f), d(3000, 0.7f);
      std::vector<uint8_t> results(1000);
      FTError code = FT_ERROR_NONE;
      while (code == FT_ERROR_NONE) code = occluded(scene, o.data(), d.data(), nullptr, 1000, results.data());
      EXPECT_EQ(code, FT_ERROR_INVALID_ARGUMENT);
    });
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);  // the scene keeps what it needs
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  for (std::thread& t : threads) t.join();
}

}  // namespace
}  // namespace fieldtrace
