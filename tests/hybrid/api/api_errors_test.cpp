// The C interface used wrongly: every call returns an error with a message, and none writes, crashes or hangs.
#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "field/bake/bake_full.h"
#include "tests/support/api_scene.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

using test::ApiScene;
using test::TemporaryFolder;

constexpr float k_nan = std::numeric_limits<float>::quiet_NaN();

struct Call {
  const char* name;
  FTError (*call)(FTScene);
};

float g_float[64];
uint32_t g_uint[64];
double g_double[3];
int64_t g_int;

// Every function of a scene, with arguments that are valid once it is committed.
const std::vector<Call>& scene_calls() {
  static const std::vector<Call> calls = {
      {"set transform", [](FTScene s) { return ftSetInstanceTransform(s, 0, nullptr); }},
      {"set reflectance", [](FTScene s) { return ftSetInstanceReflectance(s, 0, g_float); }},
      {"set radiance", [](FTScene s) { return ftSetInstanceRadiance(s, 0, g_float); }},
      {"set sky", [](FTScene s) { return ftSetSceneSky(s, g_float); }},
      {"set int", [](FTScene s) { return ftSetSceneInt(s, "spp", 1); }},
      {"set float", [](FTScene s) { return ftSetSceneFloat(s, "tolerance", 0.1); }},
      {"commit", [](FTScene s) { return ftCommitScene(s); }},
      {"origin", [](FTScene s) { return ftGetSceneOrigin(s, g_double); }},
      {"get int", [](FTScene s) { return ftGetSceneInt(s, "instances", &g_int); }},
      {"get float", [](FTScene s) { return ftGetSceneFloat(s, "certified_hits", g_double); }}};
  return calls;
}

// Those that need a commit, of no rays or points.
const std::vector<Call>& queries() {
  static const std::vector<Call> calls = {
      {"bake", [](FTScene s) { return ftBakeFields(s); }},
      {"save", [](FTScene s) { return ftSaveField(s, 0, "/nonexistent/field.vdb"); }},
      {"load", [](FTScene s) { return ftLoadField(s, 0, "/nonexistent/field.vdb"); }},
      {"bytes", [](FTScene s) { return ftGetSceneInt(s, "bytes", &g_int); }},
      {"mesh", [](FTScene s) { return ftGetMeshInt(s, 0, "bytes", &g_int); }},
      {"occluded",
       [](FTScene s) { return ftOccluded(s, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0); }},
      {"certified",
       [](FTScene s) { return ftOccludedCertified(s, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0); }},
      {"nearest",
       [](FTScene s) {
         return ftNearest(s, 0.1f, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0, nullptr, 0, nullptr,
                          0, nullptr, 0, nullptr, 0);
       }},
      {"lights",
       [](FTScene s) {
         return ftLightVisibility(s, nullptr, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0,
                                  nullptr, 0);
       }},
      {"sky",
       [](FTScene s) { return ftSkyVisibility(s, nullptr, 0, nullptr, 0, nullptr, 0, 0, nullptr, 0, nullptr, 0); }},
      {"render to file", [](FTScene s) { return ftRenderToFile(s, "/nonexistent/picture.exr"); }}};
  return calls;
}

std::string message_of(FTDevice device) {
  const char* message = nullptr;
  EXPECT_NE(ftGetDeviceError(device, &message), FT_ERROR_NONE);
  return message ? message : "";
}

FTError occluded(FTScene scene, const float* origins, const float* directions, const float* t_max, size_t count,
                 uint8_t* results) {
  return ftOccluded(scene, origins, 0, directions, 0, t_max, 0, nullptr, 0, count, results, 0);
}

TEST(ApiErrors, NullAndForeignHandles) {
  int on_stack[4] = {};
  const ApiScene s(false);
  for (const FTScene bad : {FTScene(nullptr), reinterpret_cast<FTScene>(on_stack), reinterpret_cast<FTScene>(s.device),
                            std::bit_cast<FTScene>(uintptr_t(-16))}) {
    for (const auto* calls : {&scene_calls(), &queries()}) {
      for (const Call& c : *calls) {
        EXPECT_EQ(c.call(bad), FT_ERROR_INVALID_ARGUMENT) << c.name;
        EXPECT_FALSE(message_of(nullptr).empty()) << c.name;
      }
    }
    EXPECT_EQ(ftRetainScene(bad), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftReleaseScene(bad), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftAddMesh(bad, g_float, 0, 3, g_uint, 0, 1, nullptr), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftAddInstance(bad, 0, nullptr, nullptr), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftSetSceneCamera(bad, g_float, g_float, g_float, 40, 4, 4), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftRender(bad, g_float, 0, 0), FT_ERROR_INVALID_ARGUMENT);
  }
  FTScene scene = nullptr;
  for (const FTDevice bad : {FTDevice(nullptr), reinterpret_cast<FTDevice>(s.scene)}) {
    EXPECT_EQ(ftNewScene(bad, &scene), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftLoadScene(bad, "scene.xml", &scene), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftRetainDevice(bad), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftReleaseDevice(bad), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftSetDeviceErrorCallback(bad, nullptr, nullptr), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftSetDeviceProgressCallback(bad, nullptr, nullptr), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ftSetDeviceWarningCallback(bad, nullptr, nullptr), FT_ERROR_INVALID_ARGUMENT);
  }
  EXPECT_EQ(scene, nullptr);
  EXPECT_EQ(ftNewDevice(0, nullptr), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftNewScene(s.device, nullptr), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftLoadScene(s.device, nullptr, &scene), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftLoadScene(s.device, "/nonexistent/scene.xml", &scene), FT_ERROR_INPUT);
  EXPECT_NE(message_of(s.device).find("/nonexistent/scene.xml"), std::string::npos);
}

TEST(ApiErrors, QueriesBeforeTheCommitAndGeometryAfterIt) {
  const ApiScene s(false);
  for (const Call& c : queries()) {
    EXPECT_EQ(c.call(s.scene), FT_ERROR_INVALID_OPERATION) << c.name;
    EXPECT_NE(message_of(s.device).find("commit"), std::string::npos) << c.name;
  }
  EXPECT_EQ(ftRender(s.scene, g_float, 0, 0), FT_ERROR_INVALID_OPERATION);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const float p[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const uint32_t t[3] = {0, 1, 2};
  EXPECT_EQ(ftAddMesh(s.scene, p, 0, 3, t, 0, 1, nullptr), FT_ERROR_INVALID_OPERATION);
  EXPECT_EQ(ftAddInstance(s.scene, 0, nullptr, nullptr), FT_ERROR_INVALID_OPERATION);
  EXPECT_EQ(ftSetSceneInt(s.scene, "directions", 64), FT_ERROR_INVALID_OPERATION);
  FTScene empty = nullptr;
  ASSERT_EQ(ftNewScene(s.device, &empty), FT_ERROR_NONE);
  EXPECT_EQ(ftCommitScene(empty), FT_ERROR_INVALID_OPERATION);
  EXPECT_EQ(ftReleaseScene(empty), FT_ERROR_NONE);
}

TEST(ApiErrors, NothingToDoIsNoError) {
  const ApiScene s;
  for (const Call& c : queries()) {
    const std::string name = c.name;
    const bool file = name == "save" || name == "load" || name == "render to file";
    if (name == "bake") continue;
    EXPECT_EQ(c.call(s.scene), file ? FT_ERROR_INPUT : FT_ERROR_NONE) << c.name;
  }
}

TEST(ApiErrors, GeometryAndSettings) {
  const ApiScene s(false);
  float p[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  uint32_t t[3] = {0, 1, 3}, mesh = 77;
  EXPECT_EQ(ftAddMesh(s.scene, p, 0, 3, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  t[2] = 2;
  p[4] = k_nan;
  EXPECT_EQ(ftAddMesh(s.scene, p, 0, 3, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  p[4] = 0;
  EXPECT_EQ(ftAddMesh(s.scene, nullptr, 0, 3, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAddMesh(s.scene, p, 0, 0, t, 0, 0, &mesh), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAddMesh(s.scene, p, 8, 3, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAddMesh(s.scene, p, 13, 3, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAddMesh(s.scene, p, 0, size_t(-1) / 4, t, 0, 1, &mesh), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(mesh, 77u);
  float flat[12] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0};
  EXPECT_EQ(ftAddInstance(s.scene, 0, flat, nullptr), FT_ERROR_INVALID_ARGUMENT);
  flat[4] = k_nan;
  EXPECT_EQ(ftSetInstanceTransform(s.scene, 0, flat), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetInstanceTransform(s.scene, 3, nullptr), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftAddInstance(s.scene, 2, nullptr, nullptr), FT_ERROR_INVALID_ARGUMENT);
  // Less than single precision can undo.
  const float thin[12] = {1, 0, 0, 0, 0.6f, 0.8f, 0, 0.6f, 0.80000025f, 0, 0, 0};
  ASSERT_EQ(ftSetInstanceTransform(s.scene, 1, thin), FT_ERROR_NONE);
  EXPECT_EQ(ftCommitScene(s.scene), FT_ERROR_INPUT);
  EXPECT_NE(message_of(s.device).find("instance 1: the transform all but flattens"), std::string::npos);
  ASSERT_EQ(ftSetInstanceTransform(s.scene, 1, nullptr), FT_ERROR_NONE);
  const float off[3] = {0, 0, 1e19f}, ahead[3] = {0, 0, 0}, above[3] = {0, 1, 0};
  EXPECT_EQ(ftSetSceneCamera(s.scene, off, ahead, above, 40, 4, 4), FT_ERROR_INVALID_ARGUMENT);
  const float red[3] = {2, 0, 0}, black[3] = {0, 0, 0}, bad[3] = {k_nan, 0, 0};
  EXPECT_EQ(ftSetInstanceReflectance(s.scene, 0, red), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetInstanceRadiance(s.scene, 0, bad), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneSky(s.scene, nullptr), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneCamera(s.scene, black, black, red, 40, 4, 4), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneCamera(s.scene, black, red, red, 40, 4, 4), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneInt(s.scene, "no such", 1), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(message_of(s.device).find("no such"), std::string::npos);
  EXPECT_EQ(ftSetSceneInt(s.scene, nullptr, 1), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneInt(s.scene, "plane", 65), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneInt(s.scene, "spp", -1), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetSceneFloat(s.scene, "tolerance", double(k_nan)), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftGetSceneInt(s.scene, "meshes", nullptr), FT_ERROR_INVALID_ARGUMENT);
}

TEST(ApiErrors, RaysAndBuffers) {
  const ApiScene s;
  std::vector<float> o(300, 0.5f), d(300, 1.0f), t(100, 1.0f);
  std::vector<uint8_t> results(100, 9);
  ASSERT_EQ(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), FT_ERROR_NONE);
  results.assign(100, 9);
  const auto refused = [&](FTError code, const char* what) {
    EXPECT_EQ(code, FT_ERROR_INVALID_ARGUMENT) << what;
    EXPECT_FALSE(message_of(s.device).empty()) << what;
    for (const uint8_t r : results) ASSERT_EQ(r, 9) << what;
  };
  for (float* const bad : {&o[299], d.data(), &t[50]}) {
    const float was = *bad;
    *bad = k_nan;
    refused(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), "NaN");
    *bad = was;
  }
  o[5] = std::numeric_limits<float>::infinity();
  refused(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), "infinite");
  o[5] = 1e19f;
  EXPECT_EQ(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(message_of(s.device).find("ray 1 starts beyond"), std::string::npos);
  t[1] = -1.0f;  // asks nothing
  EXPECT_EQ(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), FT_ERROR_NONE);
  results.assign(100, 9);
  o[5] = 0.5f, t[1] = 1.0f;
  std::fill_n(d.begin() + 30, 3, 0.0f);
  refused(occluded(s.scene, o.data(), d.data(), t.data(), 100, results.data()), "no direction");
  d.assign(300, 1.0f);
  refused(occluded(s.scene, nullptr, d.data(), t.data(), 100, results.data()), "null");
  refused(occluded(s.scene, o.data(), d.data(), t.data(), 100, nullptr), "null");
  const auto* const askew = reinterpret_cast<const float*>(reinterpret_cast<const char*>(o.data()) + 1);
  refused(occluded(s.scene, askew, d.data(), t.data(), 99, results.data()), "misaligned");
  const auto stride = [&](size_t bytes) {
    return ftOccluded(s.scene, o.data(), bytes, d.data(), 0, t.data(), 0, nullptr, 0, 20, results.data(), 0);
  };
  refused(stride(8), "stride");
  refused(stride(14), "stride");
  refused(stride(size_t(-4)), "stride");
  auto* const over = reinterpret_cast<uint8_t*>(d.data());
  EXPECT_EQ(occluded(s.scene, o.data(), d.data(), t.data(), 100, over + 7), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(message_of(s.device).find("overlaps"), std::string::npos);
  const std::vector<uint32_t> from(100, 3);
  refused(ftOccluded(s.scene, o.data(), 0, d.data(), 0, nullptr, 0, from.data(), 0, 100, results.data(), 0), "from");
  // Interleaved with what it answers: no overlap.
  struct Ray {
    float o[3], d[3], t;
    uint8_t result, unused[3];
  };
  std::vector<Ray> rays(10, {{0, 5, 0}, {0, -1, 0}, 10, 9, {}});
  ASSERT_EQ(ftOccluded(s.scene, rays[0].o, sizeof(Ray), rays[0].d, sizeof(Ray), &rays[0].t, sizeof(Ray), nullptr, 0, 10,
                       &rays[0].result, sizeof(Ray)),
            FT_ERROR_NONE);
  for (const Ray& r : rays) EXPECT_EQ(r.result, FT_BLOCKED);
  EXPECT_EQ(ftNearest(s.scene, 0, o.data(), 0, d.data(), 0, nullptr, 0, nullptr, 0, 9, results.data(), 0, nullptr, 0,
                      nullptr, 0, nullptr, 0, nullptr, 0),
            FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftNearest(s.scene, 0.1f, o.data(), 0, d.data(), 0, nullptr, 0, nullptr, 0, 9, results.data(), 0, t.data(),
                      0, t.data(), 0, nullptr, 0, nullptr, 0),
            FT_ERROR_INVALID_ARGUMENT);
}

TEST(ApiErrors, PointsAndLights) {
  const ApiScene s;
  float p[3] = {0, 0, 0}, n[3] = {0, 1, 0}, light[9] = {0, 4, 0, 1, 0, 0, 0, 0, 1}, share = -1;
  uint32_t shape = FT_LIGHT_RECTANGLE, from = 2;
  const auto ask = [&] {
    return ftLightVisibility(s.scene, p, 0, n, 0, &from, 0, 1, &shape, 0, light, 0, 1, &share, 0, nullptr, 0);
  };
  const auto ask_sky = [&] { return ftSkyVisibility(s.scene, p, 0, n, 0, &from, 0, 1, &share, 0, nullptr, 0); };
  for (float* const bad : {&p[1], &n[0], &light[4]}) {
    const float was = *bad;
    *bad = k_nan;
    EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
    *bad = was;
  }
  for (float* const far : {&p[0], &light[1], &light[3]}) {
    const float was = *far;
    *far = 1e19f;
    EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_EQ(ask_sky() == FT_ERROR_INVALID_ARGUMENT, far == p);
    *far = was;
  }
  share = -1;
  n[1] = 2;
  EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ask_sky(), FT_ERROR_INVALID_ARGUMENT);
  n[1] = 1;
  shape = 3;
  EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
  shape = FT_LIGHT_DISK;
  light[3] = 0;  // no area
  EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
  light[3] = 1;
  from = 3;
  EXPECT_EQ(ask(), FT_ERROR_INVALID_ARGUMENT);
  from = FT_NO_INSTANCE;
  EXPECT_EQ(ask_sky(), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(share, -1.0f);
  EXPECT_EQ(ask(), FT_ERROR_NONE);
  EXPECT_GE(share, 0.0f);
  const float black[3] = {0, 0, 0};
  EXPECT_EQ(ftRender(s.scene, nullptr, 0, 0), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(ftSetInstanceRadiance(s.scene, 0, black), FT_ERROR_NONE);
}

TEST(ApiErrors, CallbacksHearAndCancel) {
  const ApiScene s;
  std::string heard;
  const auto on_error = [](void* user, FTError, const char* message) { *static_cast<std::string*>(user) = message; };
  ASSERT_EQ(ftSetDeviceErrorCallback(s.device, on_error, &heard), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneFloat(s.scene, "tolerance", 2), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(heard.find("tolerance"), std::string::npos);
  const char* message = nullptr;
  EXPECT_EQ(ftGetDeviceError(s.device, &message), FT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(heard, message);
  EXPECT_EQ(ftGetDeviceError(s.device, &message), FT_ERROR_NONE);  // forgotten
  EXPECT_STREQ(message, "");
  int calls = 0;
  const auto stop = [](void* user, double share) {
    EXPECT_GE(share, 0.0);
    EXPECT_LE(share, 1.0);
    return ++*static_cast<int*>(user) < 2 ? 1 : 0;
  };
  ASSERT_EQ(ftSetDeviceProgressCallback(s.device, stop, &calls), FT_ERROR_NONE);
  EXPECT_EQ(ftBakeFields(s.scene), FT_ERROR_CANCELLED);
  EXPECT_EQ(calls, 2);
  int64_t baked = 0, full = 0;
  EXPECT_EQ(ftGetSceneInt(s.scene, "cells_baked", &baked), FT_ERROR_NONE);
  EXPECT_EQ(ftGetSceneInt(s.scene, "cells_full", &full), FT_ERROR_NONE);
  EXPECT_LT(baked, full / 2);

  // What is finished of a picture is there.
  const float from[] = {3, 3, 5}, to[] = {0, 0.8f, 0}, up[] = {0, 1, 0}, sky[] = {1, 1, 1};
  ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 45.0f, 64, 64), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneSky(s.scene, sky), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneInt(s.scene, "spp", 2), FT_ERROR_NONE);
  const auto stop_at_end = [](void*, double share) { return share < 1.0 ? 1 : 0; };
  ASSERT_EQ(ftSetDeviceProgressCallback(s.device, stop_at_end, nullptr), FT_ERROR_NONE);
  std::vector<float> pixels(64 * 64 * 3, -1.0f);
  EXPECT_EQ(ftRender(s.scene, pixels.data(), 0, 0), FT_ERROR_CANCELLED);
  EXPECT_EQ(std::count(pixels.begin(), pixels.end(), -1.0f), 0);
  EXPECT_GT(std::accumulate(pixels.begin(), pixels.end(), 0.0), 64.0 * 64.0 * 0.2);
  EXPECT_EQ(ftRenderToFile(s.scene, "picture.jpg"), FT_ERROR_INVALID_ARGUMENT);
}

// A single tile reports nothing before its end.
TEST(ApiErrors, OneTileOfManySamplesIsCancelledAmidst) {
  const ApiScene s;
  const float from[] = {3, 3, 5}, to[] = {0, 0.8f, 0}, up[] = {0, 1, 0}, sky[] = {1, 1, 1};
  ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 45.0f, 16, 16), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneSky(s.scene, sky), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneInt(s.scene, "spp", 1 << 16), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneFloat(s.scene, "tolerance", 0.0), FT_ERROR_NONE);  // nothing to bake, which reports, too
  double asked = -1.0;
  const auto stop = [](void* user, double share) {
    *static_cast<double*>(user) = share;
    return 0;
  };
  ASSERT_EQ(ftSetDeviceProgressCallback(s.device, stop, &asked), FT_ERROR_NONE);
  std::vector<float> pixels(16 * 16 * 3);
  EXPECT_EQ(ftRender(s.scene, pixels.data(), 0, 0), FT_ERROR_CANCELLED);
  EXPECT_GE(asked, 0.0);
  EXPECT_LT(asked, 1.0);
}

TEST(ApiErrors, PicturesAndFieldsDoNotReplaceWhatTheSceneWasReadFrom) {
  const ApiScene s;
  const TemporaryFolder folder;
  const std::string scene_path = folder / "scene.xml", map = folder / "sky.exr", link = folder / "link.exr";
  const Image image{3, 3, {"R", "G", "B"}, std::vector<float>(27, 1.0f)};
  write_image(map, image);
  std::filesystem::create_symlink(map, link);
  std::ofstream(scene_path) << "<scene version=\"3.0.0\"><emitter type=\"envmap\"><string name=\"filename\" value=\""
                            << map << "\"/></emitter><shape type=\"cube\"/></scene>";
  FTScene scene = nullptr;
  ASSERT_EQ(ftLoadScene(s.device, scene_path.c_str(), &scene), FT_ERROR_NONE);
  for (const std::string& path : {map, link}) {
    EXPECT_EQ(ftRenderToFile(scene, path.c_str()), FT_ERROR_INVALID_ARGUMENT);
    EXPECT_NE(message_of(s.device).find("would overwrite"), std::string::npos);
  }
  EXPECT_EQ(read_image(map).width, 3);
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
}

TEST(ApiErrors, WarningsAreHeard) {
  const ApiScene s;
  const TemporaryFolder folder;
  const std::string path = folder / "scene.xml";
  std::ofstream(path) << "<scene version=\"3.0.0\">\n<emitter type=\"constant\"/>\n<shape type=\"torus\"/>\n</scene>\n";
  std::vector<std::string> heard;
  const auto on_warning = [](void* user, const char* message) {
    static_cast<std::vector<std::string>*>(user)->emplace_back(message);
  };
  ASSERT_EQ(ftSetDeviceWarningCallback(s.device, on_warning, &heard), FT_ERROR_NONE);
  FTScene scene = nullptr;
  ASSERT_EQ(ftLoadScene(s.device, path.c_str(), &scene), FT_ERROR_NONE);
  const auto of_torus = [&](const std::string& message) {
    return message.find(path + ":3: ") == 0 && message.find("torus") != std::string::npos;
  };
  EXPECT_EQ(std::count_if(heard.begin(), heard.end(), of_torus), 1);
  const size_t count = heard.size();
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  // None is left that could be called.
  ASSERT_EQ(ftSetDeviceWarningCallback(s.device, nullptr, nullptr), FT_ERROR_NONE);
  ASSERT_EQ(ftLoadScene(s.device, path.c_str(), &scene), FT_ERROR_NONE);
  EXPECT_EQ(heard.size(), count);
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
}

TEST(ApiErrors, FieldsBeyondTheirMemoryAreOutOfMemory) {
  // For less than the cells, and for the cells without the tiles that lights ask for.
  const auto cells = int64_t(full_brick_bytes({.directions = 32, .plane = 64}));
  for (const int64_t memory : {int64_t(1) << 20, cells + 100'000}) {
    const ApiScene s(/*commits=*/false);
    ASSERT_EQ(ftSetSceneInt(s.scene, "field_memory", memory), FT_ERROR_NONE);
    ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
    EXPECT_EQ(ftBakeFields(s.scene), FT_ERROR_OUT_OF_MEMORY) << memory;
    EXPECT_NE(message_of(s.device).find("field_memory"), std::string::npos);
    int64_t baked = -1;
    ASSERT_EQ(ftGetSceneInt(s.scene, "cells_baked", &baked), FT_ERROR_NONE);
    EXPECT_EQ(baked > 0, memory > cells);  // what fits is kept
  }
}

// A field's own memory suffices for all that its file holds, and for a bake that finds it all there; an eighth of it
// does not.
TEST(ApiErrors, AFieldThatIsReadInPartIsOutOfMemory) {
  const test::TemporaryFolder folder;
  const std::string whole = folder / "whole.vdb", part = folder / "part.vdb";
  int64_t bytes = 0, cells = 0, baked = 0;
  {
    const ApiScene s;
    ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
    ASSERT_EQ(ftSaveField(s.scene, 0, whole.c_str()), FT_ERROR_NONE);
    ASSERT_EQ(ftGetSceneInt(s.scene, "bytes", &bytes), FT_ERROR_NONE);
    ASSERT_EQ(ftGetSceneInt(s.scene, "cells_baked", &cells), FT_ERROR_NONE);
  }
  for (const bool fits : {false, true}) {
    const ApiScene s(/*commits=*/false);
    ASSERT_EQ(ftSetSceneInt(s.scene, "field_memory", fits ? bytes : bytes / 8), FT_ERROR_NONE);
    ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
    const FTError expected = fits ? FT_ERROR_NONE : FT_ERROR_OUT_OF_MEMORY;
    EXPECT_EQ(ftLoadField(s.scene, 0, whole.c_str()), expected);
    if (!fits) {
      EXPECT_NE(message_of(s.device).find("field_memory"), std::string::npos);
    }
    EXPECT_EQ(ftBakeFields(s.scene), expected);
    ASSERT_EQ(ftGetSceneInt(s.scene, "cells_baked", &baked), FT_ERROR_NONE);
    EXPECT_GT(baked, 0);
    EXPECT_EQ(baked == cells, fits);
    // What is there already takes no room.
    ASSERT_EQ(ftSaveField(s.scene, 0, part.c_str()), FT_ERROR_NONE);
    EXPECT_EQ(ftLoadField(s.scene, 0, part.c_str()), FT_ERROR_NONE);
  }
}

// `fieldtrace render` takes it, too.
TEST(ApiErrors, AFileOfASkyAloneIsNone) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "sky.xml";
  std::ofstream(path) << R"(<scene version="3.0.0">
    <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
    <sensor type="perspective"><sampler type="independent"><integer name="sample_count" value="1"/></sampler>
      <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/>
      </film></sensor></scene>)";
  FTDevice device = nullptr;
  FTScene scene = nullptr;
  ASSERT_EQ(ftNewDevice(2, &device), FT_ERROR_NONE);
  ASSERT_EQ(ftLoadScene(device, path.c_str(), &scene), FT_ERROR_NONE);
  for (int commit = 0; commit < 2; ++commit) {
    std::vector<float> pixels(4 * 4 * 3, -1.0f);
    ASSERT_EQ(ftRender(scene, pixels.data(), 0, 0), FT_ERROR_NONE);
    for (const float value : pixels) EXPECT_NEAR(value, 0.5f, 1e-6f);
    const float origin[3] = {0, 0, 0}, direction[3] = {0, 1, 0};
    uint8_t result = 9, status = 9;
    EXPECT_EQ(occluded(scene, origin, direction, nullptr, 1, &result), FT_ERROR_NONE);
    EXPECT_EQ(result, FT_CLEAR);
    EXPECT_EQ(ftNearest(scene, 0.1f, origin, 0, direction, 0, nullptr, 0, nullptr, 0, 1, &status, 0, nullptr, 0,
                        nullptr, 0, nullptr, 0, nullptr, 0),
              FT_ERROR_NONE);
    EXPECT_EQ(status, FT_MISS);
    EXPECT_EQ(ftBakeFields(scene), FT_ERROR_NONE);
    ASSERT_EQ(ftCommitScene(scene), FT_ERROR_NONE);
  }
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
}

}  // namespace
}  // namespace fieldtrace
