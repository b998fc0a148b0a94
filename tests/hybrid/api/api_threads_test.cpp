// The C interface from many threads at once, and handles that are released while they are in use.
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "fieldtrace/fieldtrace_embree.h"
#include "tests/support/api_scene.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

using test::ApiScene;

FTError occluded(FTScene scene, const float* origins, const float* directions, const float* t_max, size_t count,
                 uint8_t* results) {
  return ftOccluded(scene, origins, 0, directions, 0, t_max, 0, nullptr, 0, count, results, 0);
}

// What the calls of one thread read and write.
struct Caller {
  FTDevice device;
  FTScene scene;
  std::string folder;
  RTCDevice embree;
  RTCScene target;
  float origins[96], directions[96], normals[96], pixels[8 * 8 * 3], results[64], more[64];
  uint32_t from[32], kinds[1] = {FT_LIGHT_SPHERE};
  uint8_t bytes[32];
  float transform[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.2f, 1.4f, 0}, light[9] = {0, 6, 0, 1, 0, 0, 0, 1, 0};
  uint32_t number = 0;

  explicit Caller(int seed) {
    for (int i = 0; i < 96; ++i) {
      origins[i] = float((i * 7 + seed) % 13) / 3.0f - 2.0f, directions[i] = float((i * 5 + seed) % 11) - 4.6f;
      normals[i] = i % 3 == 1 ? 1.0f : 0.0f;
    }
    std::fill_n(from, 32, 2u);
  }
};

struct Function {
  const char* name;
  std::function<FTError(Caller&)> call;
  FTError expected = FT_ERROR_NONE;
};

// For Caller::pixels.
FTError set_small_camera(FTScene scene) {
  const float at[3] = {0, 2, 5}, to[3] = {0, 1, 0}, up[3] = {0, 1, 0};
  return ftSetSceneCamera(scene, at, to, up, 40, 8, 8);
}

constexpr FTError k_order = FT_ERROR_INVALID_OPERATION;

// Every function of the headers, with what it returns on a committed scene.
std::vector<Function> functions() {
  using C = Caller&;
  return {
      {"ftGetVersion", [](C) { return ftGetVersion() ? FT_ERROR_NONE : FT_ERROR_UNKNOWN; }},
      {"ftNewDevice",
       [](C) {
         FTDevice d = nullptr;
         const FTError error = ftNewDevice(1, &d);
         return error ? error : ftReleaseDevice(d);
       }},
      {"ftRetainDevice", [](C c) { return ftRetainDevice(c.device); }},
      {"ftReleaseDevice", [](C c) { return ftReleaseDevice(c.device); }},
      {"ftGetDeviceError", [](C c) { return ftGetDeviceError(c.device, nullptr); }},
      {"ftSetDeviceErrorCallback", [](C c) { return ftSetDeviceErrorCallback(c.device, nullptr, nullptr); }},
      {"ftSetDeviceProgressCallback", [](C c) { return ftSetDeviceProgressCallback(c.device, nullptr, nullptr); }},
      {"ftNewScene",
       [](C c) {
         FTScene s = nullptr;
         const FTError error = ftNewScene(c.device, &s);
         return error ? error : ftReleaseScene(s);
       }},
      {"ftLoadScene",
       [](C c) {
         FTScene s = nullptr;
         return ftLoadScene(c.device, (c.folder + "/none.xml").c_str(), &s);
       },
       FT_ERROR_INPUT},
      {"ftRetainScene", [](C c) { return ftRetainScene(c.scene); }},
      {"ftReleaseScene", [](C c) { return ftReleaseScene(c.scene); }},
      {"ftAddMesh", [](C c) { return ftAddMesh(c.scene, c.origins, 0, 32, c.from, 0, 10, &c.number); }, k_order},
      {"ftAddInstance", [](C c) { return ftAddInstance(c.scene, 0, c.transform, &c.number); }, k_order},
      {"ftSetInstanceTransform", [](C c) { return ftSetInstanceTransform(c.scene, 0, c.transform); }},
      {"ftSetInstanceReflectance", [](C c) { return ftSetInstanceReflectance(c.scene, 0, c.normals); }},
      {"ftSetInstanceRadiance", [](C c) { return ftSetInstanceRadiance(c.scene, 0, c.normals); }},
      {"ftSetSceneSky", [](C c) { return ftSetSceneSky(c.scene, c.normals); }},
      {"ftSetSceneCamera", [](C c) { return set_small_camera(c.scene); }},
      {"ftSetSceneInt", [](C c) { return ftSetSceneInt(c.scene, "spp", 1); }},
      {"ftSetSceneFloat", [](C c) { return ftSetSceneFloat(c.scene, "tolerance", 0.1); }},
      {"ftCommitScene", [](C c) { return ftCommitScene(c.scene); }},
      {"ftGetSceneOrigin",
       [](C c) {
         double origin[3];
         return ftGetSceneOrigin(c.scene, origin);
       }},
      {"ftBakeFields", [](C c) { return ftBakeFields(c.scene); }},
      {"ftSaveField", [](C c) { return ftSaveField(c.scene, 0, (c.folder + "/field.vdb").c_str()); }},
      {"ftLoadField", [](C c) { return ftLoadField(c.scene, 0, (c.folder + "/none.vdb").c_str()); }, FT_ERROR_INPUT},
      {"ftGetSceneInt",
       [](C c) {
         int64_t value = 0;
         return ftGetSceneInt(c.scene, "cells_baked", &value);
       }},
      {"ftGetMeshInt",
       [](C c) {
         int64_t value = 0;
         return ftGetMeshInt(c.scene, 0, "bytes", &value);
       }},
      {"ftGetSceneFloat",
       [](C c) {
         double value = 0;
         return ftGetSceneFloat(c.scene, "certified_hits", &value);
       }},
      {"ftOccluded", [](C c) { return occluded(c.scene, c.origins, c.directions, nullptr, 32, c.bytes); }},
      {"ftOccludedCertified",
       [](C c) {
         return ftOccludedCertified(c.scene, c.origins, 0, c.directions, 0, nullptr, 0, nullptr, 0, 32, c.bytes, 0);
       }},
      {"ftNearest",
       [](C c) {
         return ftNearest(c.scene, 0.05f, c.origins, 0, c.directions, 0, nullptr, 0, nullptr, 0, 32, c.bytes, 0,
                          c.results, 0, nullptr, 0, nullptr, 0, nullptr, 0);
       }},
      {"ftLightVisibility",
       [](C c) {
         return ftLightVisibility(c.scene, c.origins, 0, c.normals, 0, c.from, 0, 32, c.kinds, 0, c.light, 0, 1,
                                  c.results, 0, c.more, 0);
       }},
      {"ftSkyVisibility",
       [](C c) {
         return ftSkyVisibility(c.scene, c.origins, 0, c.normals, 0, c.from, 0, 32, c.results, 0, c.more, 0);
       }},
      {"ftRender", [](C c) { return ftRender(c.scene, c.pixels, 0, 0); }},
      {"ftRenderToFile", [](C c) { return ftRenderToFile(c.scene, (c.folder + "/none/picture.exr").c_str()); },
       FT_ERROR_INPUT},
      {"ftAttachEmbree", [](C c) { return ftAttachEmbree(c.scene, c.embree, c.target, nullptr); }},
      {"ftDetachEmbree", [](C c) { return ftDetachEmbree(c.scene, c.target); }},
  };
}

TEST(ApiThreads, TheTableHoldsEveryFunction) {
  std::set<std::string> declared, called;
  for (const char* const header : {"fieldtrace.h", "fieldtrace_embree.h"}) {
    std::ifstream file(std::string(FIELDTRACE_SOURCE_DIR) + "/fieldtrace/" + header);
    const std::string text((std::istreambuf_iterator<char>(file)), {});
    for (size_t at = text.find("\nFT_API "); at != std::string::npos; at = text.find("\nFT_API ", at + 1)) {
      const size_t name = text.find(" ft", at) + 1;
      declared.insert(text.substr(name, text.find('(', name) - name));
    }
  }
  for (const Function& f : functions()) called.insert(f.name);
  EXPECT_GT(declared.size(), 30u);
  EXPECT_EQ(called, declared);
}

// Eight threads begin at different functions of one scene.
TEST(ApiThreads, EveryFunctionAtOnce) {
  const test::TemporaryFolder folder;
  const ApiScene s;
  ASSERT_EQ(set_small_camera(s.scene), FT_ERROR_NONE);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const std::vector<Function> all = functions();
  const RTCDevice embree = rtcNewDevice("threads=1");
  std::vector<std::thread> threads;
  for (int k = 0; k < 8; ++k) {
    threads.emplace_back([&, k] {
      Caller c(k);
      c.device = s.device, c.scene = s.scene, c.embree = embree, c.target = rtcNewScene(embree);
      c.folder = folder / std::to_string(k);
      std::filesystem::create_directory(c.folder);
      // A reference of its own, whatever the others do.
      EXPECT_EQ(ftRetainScene(c.scene), FT_ERROR_NONE);
      EXPECT_EQ(ftRetainDevice(c.device), FT_ERROR_NONE);
      for (size_t i = 0; i < all.size(); ++i) {
        const Function& f = all[(i + size_t(k) * 5) % all.size()];
        const std::string name = f.name;
        if (name == "ftGetDeviceError") {
          (void)f.call(c);  // of the thread's last call
          continue;
        }
        // In pairs, so that every thread keeps its reference, and attaches before it detaches.
        const auto pair = [&](const char* first, const char* second) { return name == first || name == second; };
        if (pair("ftRetainScene", "ftReleaseScene")) {
          EXPECT_EQ(ftRetainScene(c.scene), FT_ERROR_NONE);
          EXPECT_EQ(ftReleaseScene(c.scene), FT_ERROR_NONE);
        } else if (pair("ftRetainDevice", "ftReleaseDevice")) {
          EXPECT_EQ(ftRetainDevice(c.device), FT_ERROR_NONE);
          EXPECT_EQ(ftReleaseDevice(c.device), FT_ERROR_NONE);
        } else if (pair("ftAttachEmbree", "ftDetachEmbree")) {
          EXPECT_EQ(ftAttachEmbree(c.scene, c.embree, c.target, nullptr), FT_ERROR_NONE);
          EXPECT_EQ(ftDetachEmbree(c.scene, c.target), FT_ERROR_NONE);
        } else {
          EXPECT_EQ(f.call(c), f.expected) << name;
        }
      }
      EXPECT_EQ(ftReleaseScene(c.scene), FT_ERROR_NONE);
      EXPECT_EQ(ftReleaseDevice(c.device), FT_ERROR_NONE);
      rtcReleaseScene(c.target);
    });
  }
  for (std::thread& t : threads) t.join();
  rtcReleaseDevice(embree);
}

// Every thread asks while one moves instances and another releases.
TEST(ApiThreads, AskCommitAndReleaseAtOnce) {
  const auto [device, scene] = ApiScene().take();
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
  const auto [device, scene] = ApiScene().take();
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
