// Every function of fieldtrace.h against every misuse that applies to it, by a table that must name them all.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <bit>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "fieldtrace/fieldtrace_embree.h"
#include "tests/support/api_scene.h"

namespace fieldtrace {
namespace {

using test::ApiScene;

constexpr size_t k_count = 3;  // of the elements of every buffer
constexpr int k_threads = 8;

enum class Kind { floats, indices, text, result };
enum class Handle { none, device, scene };
enum class Order { any, before_commit, after_commit };

struct Argument {
  std::string name;
  Kind kind;
  std::vector<float> floats;      // of one element
  std::vector<uint32_t> indices;  // of one element, or of all
  std::string text;
  size_t bytes = 0;      // of an element
  size_t alignment = 4;  // of its numbers
  size_t elements = 1;
  bool has_stride = false, may_be_null = false;
};

Argument floats(const char* name, const std::vector<float>& v) {
  return {.name = name, .kind = Kind::floats, .floats = v, .indices = {}, .text = {}, .bytes = 4 * v.size()};
}
Argument indices(const char* name, const std::vector<uint32_t>& v) {
  return {.name = name, .kind = Kind::indices, .floats = {}, .indices = v, .text = {}, .bytes = 4 * v.size()};
}
Argument text(const char* name, const std::string& t) {
  return {.name = name, .kind = Kind::text, .floats = {}, .indices = {}, .text = t};
}
Argument result(const char* name, size_t bytes, size_t alignment) {
  Argument a = {.name = name, .kind = Kind::result, .floats = {}, .indices = {}, .text = {}, .bytes = bytes};
  a.alignment = alignment;
  return a;
}
Argument buffer(Argument a, size_t elements = k_count) {
  a.has_stride = true, a.elements = elements;
  return a;
}
Argument maybe(Argument a) {
  a.may_be_null = true;
  return a;
}

// Arguments of one call: valid ones in memory of their own.
class Use {
 public:
  FTDevice device = nullptr;
  FTScene scene = nullptr;
  size_t count = k_count;
  std::vector<void*> data;
  std::vector<size_t> strides;

  Use(const std::vector<Argument>& arguments, FTDevice d, FTScene s) : device(d), scene(s) {
    for (const Argument& a : arguments) {
      // Room for a shift, aligned to 8.
      memory_.emplace_back(a.bytes * a.elements / 8 + 8, 0x0909090909090909u);
      auto* const begin = reinterpret_cast<char*>(memory_.back().data());
      for (size_t i = 0; i < a.elements; ++i) {
        if (a.kind == Kind::floats) std::memcpy(begin + i * a.bytes, a.floats.data(), a.bytes);
        if (a.kind == Kind::indices) std::memcpy(begin + i * a.bytes, a.indices.data(), a.bytes);
      }
      if (a.kind == Kind::text) {
        static std::atomic<int> number = 0;
        texts_.push_back(std::make_unique<std::string>(a.text));
        std::string& t = *texts_.back();
        if (const size_t at = t.find('#'); at != std::string::npos)
          t.replace(at, 1, std::to_string(++number)), files_.push_back(t);
        data.push_back(t.data());
      } else {
        data.push_back(begin);
      }
      strides.push_back(0);
    }
  }
  ~Use() {
    for (const std::string& file : files_) std::remove(file.c_str());
  }
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;

  const float* f(size_t i) const { return static_cast<const float*>(data[i]); }
  const uint32_t* n(size_t i) const { return static_cast<const uint32_t*>(data[i]); }
  const char* text(size_t i) const { return static_cast<const char*>(data[i]); }
  template <class T>
  T* out(size_t i) const {
    return static_cast<T*>(data[i]);
  }
  const std::vector<std::vector<uint64_t>>& memory() const { return memory_; }

 private:
  std::vector<std::vector<uint64_t>> memory_;
  std::vector<std::unique_ptr<std::string>> texts_;
  std::vector<std::string> files_;
};

struct Function {
  std::string name;
  Handle handle;
  Order order;
  std::vector<Argument> arguments;
  std::function<FTError(const Use&)> call;
  bool is_query = false;  // no rays or points, at null, are no error
};

std::string field_file() { return testing::TempDir() + "api_misuse_field.vdb"; }

int go_on(void*, double) { return 1; }

// Attaches to an Embree scene of its own, and detaches; an argument that is null stands for what it names. `of_detach`:
// the code is that of detaching.
FTError attach_and_detach(const Use& u, bool of_detach) {
  static const RTCDevice embree = rtcNewDevice("threads=1");
  const RTCScene target = rtcNewScene(embree);
  FTError code = FT_ERROR_NONE;
  if (of_detach) {
    const bool is_attached = ftAttachEmbree(u.scene, embree, target, nullptr) == FT_ERROR_NONE;
    code = ftDetachEmbree(u.scene, u.data[0] ? target : nullptr);
    if (is_attached && code != FT_ERROR_NONE) {
      EXPECT_EQ(ftDetachEmbree(u.scene, target), FT_ERROR_NONE);
    }
  } else {
    code = ftAttachEmbree(u.scene, u.data[0] ? embree : nullptr, u.data[1] ? target : nullptr, u.out<uint32_t>(2));
    if (code == FT_ERROR_NONE) {
      EXPECT_EQ(ftDetachEmbree(u.scene, target), FT_ERROR_NONE);
    }
  }
  rtcReleaseScene(target);
  return code;
}

const std::vector<Function>& functions() {
  static const std::vector<Function> table = [] {
    const std::vector<float> identity = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    const std::vector<Argument> rays = {buffer(floats("origins", {-1.2f, 5, 0})),
                                        buffer(floats("directions", {0, -1, 0})), buffer(maybe(floats("t_max", {10}))),
                                        buffer(maybe(indices("from", {2})))};
    const std::vector<Argument> points = {buffer(floats("points", {0, 0, 0})), buffer(floats("normals", {0, 1, 0}))};
    const auto with = [](std::vector<Argument> a, const std::vector<Argument>& more) {
      a.insert(a.end(), more.begin(), more.end());
      return a;
    };
    const auto ask = [](auto function) {
      return [function](const Use& u) {
        return function(u.scene, u.f(0), u.strides[0], u.f(1), u.strides[1], u.f(2), u.strides[2], u.n(3), u.strides[3],
                        u.count, u.out<uint8_t>(4), u.strides[4]);
      };
    };
    const auto new_device = [](const Use& u) {
      const FTError code = ftNewDevice(1, u.out<FTDevice>(0));
      return code == FT_ERROR_NONE ? ftReleaseDevice(*u.out<FTDevice>(0)) : code;
    };
    const auto new_scene = [](const Use& u) {
      const FTError code = ftNewScene(u.device, u.out<FTScene>(0));
      return code == FT_ERROR_NONE ? ftReleaseScene(*u.out<FTScene>(0)) : code;
    };
    const auto load_scene = [](const Use& u) {
      const FTError code = ftLoadScene(u.device, u.text(0), u.out<FTScene>(1));
      return code == FT_ERROR_NONE ? ftReleaseScene(*u.out<FTScene>(1)) : code;
    };
    // A reference and back.
    const auto device_reference = [](const Use& u) {
      const FTError code = ftRetainDevice(u.device);
      return code == FT_ERROR_NONE ? ftReleaseDevice(u.device) : code;
    };
    const auto scene_reference = [](const Use& u) {
      const FTError code = ftRetainScene(u.scene);
      return code == FT_ERROR_NONE ? ftReleaseScene(u.scene) : code;
    };
    const Argument sheet = buffer(indices("triangles", {0, 1, 2}));
    std::vector<Function> f = {
        {"ftNewDevice", Handle::none, Order::any, {result("device", 8, 8)}, new_device},
        {"ftRetainDevice", Handle::device, Order::any, {}, device_reference},
        {"ftReleaseDevice", Handle::device, Order::any, {}, device_reference},
        {"ftSetDeviceErrorCallback",
         Handle::device,
         Order::any,
         {},
         [](const Use& u) { return ftSetDeviceErrorCallback(u.device, nullptr, nullptr); }},
        {"ftSetDeviceProgressCallback",
         Handle::device,
         Order::any,
         {},
         [](const Use& u) { return ftSetDeviceProgressCallback(u.device, go_on, nullptr); }},
        {"ftSetDeviceWarningCallback",
         Handle::device,
         Order::any,
         {},
         [](const Use& u) { return ftSetDeviceWarningCallback(u.device, nullptr, nullptr); }},
        {"ftNewScene", Handle::device, Order::any, {result("scene", 8, 8)}, new_scene},
        {"ftLoadScene",
         Handle::device,
         Order::any,
         {text("path", FIELDTRACE_SOURCE_DIR "/scenes/rectangle_light_box.xml"), result("scene", 8, 8)},
         load_scene},
        {"ftRetainScene", Handle::scene, Order::any, {}, scene_reference},
        {"ftReleaseScene", Handle::scene, Order::any, {}, scene_reference},
        {"ftAddMesh",
         Handle::scene,
         Order::before_commit,
         {buffer(floats("positions", {1, 2, 3})), sheet, maybe(result("mesh", 4, 4))},
         [](const Use& u) {
           return ftAddMesh(u.scene, u.f(0), u.strides[0], u.count, u.n(1), u.strides[1], u.count, u.out<uint32_t>(2));
         }},
        {"ftAddInstance",
         Handle::scene,
         Order::before_commit,
         {maybe(floats("transform", identity)), maybe(result("instance", 4, 4))},
         [](const Use& u) { return ftAddInstance(u.scene, 0, u.f(0), u.out<uint32_t>(1)); }},
        {"ftSetInstanceTransform",
         Handle::scene,
         Order::any,
         {maybe(floats("transform", identity))},
         [](const Use& u) { return ftSetInstanceTransform(u.scene, 2, u.f(0)); }},
        {"ftSetInstanceReflectance",
         Handle::scene,
         Order::any,
         {floats("rgb", {1, 0, 0.5f})},
         [](const Use& u) { return ftSetInstanceReflectance(u.scene, 1, u.f(0)); }},
        {"ftSetInstanceRadiance",
         Handle::scene,
         Order::any,
         {floats("rgb", {1, 0, 0.5f})},
         [](const Use& u) { return ftSetInstanceRadiance(u.scene, 1, u.f(0)); }},
        {"ftSetSceneSky",
         Handle::scene,
         Order::any,
         {floats("rgb", {1, 0, 0.5f})},
         [](const Use& u) { return ftSetSceneSky(u.scene, u.f(0)); }},
        {"ftSetSceneCamera",
         Handle::scene,
         Order::any,
         {floats("from", {0, 2, 9}), floats("to", {0, 1, 0}), floats("up", {0, 1, 0})},
         [](const Use& u) { return ftSetSceneCamera(u.scene, u.f(0), u.f(1), u.f(2), 40, 4, 3); }},
        {"ftSetSceneInt",
         Handle::scene,
         Order::any,
         {text("name", "spp")},
         [](const Use& u) { return ftSetSceneInt(u.scene, u.text(0), 1); }},
        {"ftSetSceneFloat",
         Handle::scene,
         Order::any,
         {text("name", "tolerance")},
         [](const Use& u) { return ftSetSceneFloat(u.scene, u.text(0), 0.05); }},
        {"ftCommitScene", Handle::scene, Order::any, {}, [](const Use& u) { return ftCommitScene(u.scene); }},
        {"ftGetSceneOrigin",
         Handle::scene,
         Order::any,
         {result("origin", 24, 8)},
         [](const Use& u) { return ftGetSceneOrigin(u.scene, u.out<double>(0)); }},
        {"ftBakeFields", Handle::scene, Order::after_commit, {}, [](const Use& u) { return ftBakeFields(u.scene); }},
        {"ftSaveField",
         Handle::scene,
         Order::after_commit,
         {text("path", testing::TempDir() + "api_misuse_#.vdb")},
         [](const Use& u) { return ftSaveField(u.scene, 0, u.text(0)); }},
        {"ftLoadField",
         Handle::scene,
         Order::after_commit,
         {text("path", field_file())},
         [](const Use& u) { return ftLoadField(u.scene, 0, u.text(0)); }},
        {"ftGetSceneInt",
         Handle::scene,
         Order::after_commit,
         {text("name", "plane"), result("value", 8, 8)},
         [](const Use& u) { return ftGetSceneInt(u.scene, u.text(0), u.out<int64_t>(1)); }},
        {"ftGetMeshInt",
         Handle::scene,
         Order::after_commit,
         {text("name", "cells_full"), result("value", 8, 8)},
         [](const Use& u) { return ftGetMeshInt(u.scene, 0, u.text(0), u.out<int64_t>(1)); }},
        {"ftGetSceneFloat",
         Handle::scene,
         Order::any,
         {text("name", "certified_hits"), result("value", 8, 8)},
         [](const Use& u) { return ftGetSceneFloat(u.scene, u.text(0), u.out<double>(1)); }},
        {"ftOccluded", Handle::scene, Order::after_commit, with(rays, {buffer(result("results", 1, 1))}),
         ask(ftOccluded), true},
        {"ftOccludedCertified", Handle::scene, Order::after_commit, with(rays, {buffer(result("results", 1, 1))}),
         ask(ftOccludedCertified), true},
        {"ftNearest", Handle::scene, Order::after_commit,
         with(rays, {buffer(result("status", 1, 1)), buffer(maybe(result("t", 4, 4))),
                     buffer(maybe(result("normals", 12, 4))), buffer(maybe(result("primitives", 4, 4))),
                     buffer(maybe(result("instances", 4, 4)))}),
         [](const Use& u) {
           const auto& s = u.strides;
           return ftNearest(u.scene, 0.05f, u.f(0), s[0], u.f(1), s[1], u.f(2), s[2], u.n(3), s[3], u.count,
                            u.out<uint8_t>(4), s[4], u.out<float>(5), s[5], u.out<float>(6), s[6], u.out<uint32_t>(7),
                            s[7], u.out<uint32_t>(8), s[8]);
         },
         true},
        {"ftLightVisibility", Handle::scene, Order::after_commit,
         with(points,
              {buffer(maybe(indices("from", {2}))), buffer(indices("shapes", {FT_LIGHT_DISK})),
               buffer(floats("lights", {0, 4, 0, 1, 0, 0, 0, 0, 1})), buffer(result("shares", 4, 4), k_count * k_count),
               buffer(maybe(result("certain", 4, 4)), k_count * k_count)}),
         [](const Use& u) {
           const auto& s = u.strides;
           return ftLightVisibility(u.scene, u.f(0), s[0], u.f(1), s[1], u.n(2), s[2], u.count, u.n(3), s[3], u.f(4),
                                    s[4], u.count, u.out<float>(5), s[5], u.out<float>(6), s[6]);
         },
         true},
        {"ftSkyVisibility", Handle::scene, Order::after_commit,
         with(points,
              {buffer(indices("from", {2})), buffer(result("shares", 4, 4)), buffer(maybe(result("certain", 4, 4)))}),
         [](const Use& u) {
           const auto& s = u.strides;
           return ftSkyVisibility(u.scene, u.f(0), s[0], u.f(1), s[1], u.n(2), s[2], u.count, u.out<float>(3), s[3],
                                  u.out<float>(4), s[4]);
         },
         true},
        // Rows of 4 pixels, 3 of them.
        {"ftRender",
         Handle::scene,
         Order::after_commit,
         {buffer(result("pixels", 12, 4), 12)},
         [](const Use& u) { return ftRender(u.scene, u.out<float>(0), u.strides[0], 0); }},
        {"ftRenderToFile",
         Handle::scene,
         Order::after_commit,
         {text("path", testing::TempDir() + "api_misuse_#.png")},
         [](const Use& u) { return ftRenderToFile(u.scene, u.text(0)); }},
        {"ftAttachEmbree",
         Handle::scene,
         Order::after_commit,
         {text("device", ""), text("target", ""), maybe(result("geometry_ids", 12, 4))},
         [](const Use& u) { return attach_and_detach(u, false); }},
        {"ftDetachEmbree", Handle::scene, Order::any, {text("target", "")}, [](const Use& u) {
           return attach_and_detach(u, true);
         }}};
    return f;
  }();
  return table;
}

// Ready for a picture of 4 x 3 pixels; with the file of a field.
std::unique_ptr<ApiScene> make_scene(bool commits = true) {
  auto s = std::make_unique<ApiScene>(false);
  const float from[3] = {0, 2, 9}, to[3] = {0, 1, 0}, up[3] = {0, 1, 0}, sky[3] = {1, 1, 1};
  EXPECT_EQ(ftSetSceneCamera(s->scene, from, to, up, 40, 4, 3), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneSky(s->scene, sky), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneInt(s->scene, "spp", 1), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneInt(s->scene, "montecarlo", 1), FT_ERROR_NONE);  // quick
  if (!commits) return s;
  EXPECT_EQ(ftCommitScene(s->scene), FT_ERROR_NONE);
  static const FTError saved = ftSaveField(s->scene, 0, field_file().c_str());
  EXPECT_EQ(saved, FT_ERROR_NONE);
  return s;
}

void forget_errors(FTDevice device) { ftGetDeviceError(device, nullptr), ftGetDeviceError(nullptr, nullptr); }

// The code, which has a message, and nothing was written.
void expect_error(const Function& f, const Use& use, FTError code, const std::string& what, FTDevice device) {
  forget_errors(device);
  std::vector<std::vector<uint64_t>> before;  // a copy: the call may write there
  before = use.memory();
  EXPECT_EQ(f.call(use), code) << f.name << ", " << what;
  const char* message = nullptr;
  EXPECT_EQ(ftGetDeviceError(device, &message), code) << f.name << ", " << what;
  EXPECT_STRNE(message, "") << f.name << ", " << what;
  EXPECT_EQ(use.memory(), before) << f.name << ", " << what;
}

// A scene for a call in the right order.
struct Scenes {
  std::unique_ptr<ApiScene> open = make_scene(false), committed = make_scene();
  const ApiScene& of(const Function& f) const { return f.order == Order::before_commit ? *open : *committed; }
};

TEST(ApiMisuse, TheTableNamesEveryFunction) {
  std::set<std::string> declared, named = {"ftGetDeviceError"};  // which hands errors out
  for (const char* const header : {"fieldtrace.h", "fieldtrace_embree.h"}) {
    std::ifstream file(std::string(FIELDTRACE_SOURCE_DIR "/fieldtrace/") + header);
    const std::string code((std::istreambuf_iterator<char>(file)), {});
    const std::string mark = "\nFT_API FTError ";
    for (size_t at = code.find(mark); at != std::string::npos; at = code.find(mark, at + 1)) {
      const size_t name = at + mark.size();
      declared.insert(code.substr(name, code.find('(', name) - name));
    }
  }
  for (const Function& f : functions()) EXPECT_TRUE(named.insert(f.name).second) << f.name << " is there twice";
  EXPECT_GT(declared.size(), 30u);
  EXPECT_EQ(declared, named);
}

TEST(ApiMisuse, ValidCallsSucceed) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    if (f.name == "ftSkyVisibility") continue;  // bakes for seconds; EachFromEightThreads has it
    const ApiScene& s = scenes.of(f);
    EXPECT_EQ(f.call(Use(f.arguments, s.device, s.scene)), FT_ERROR_NONE) << f.name;
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      if (!f.arguments[i].may_be_null) continue;
      Use use(f.arguments, s.device, s.scene);
      use.data[i] = nullptr;
      EXPECT_EQ(f.call(use), FT_ERROR_NONE) << f.name << ", no " << f.arguments[i].name;
    }
  }
}

TEST(ApiMisuse, HandlesThatAreNone) {
  const Scenes scenes;
  const auto [freed_device, freed_scene] = ApiScene(false).take();
  ASSERT_EQ(ftReleaseScene(freed_scene), FT_ERROR_NONE);
  ASSERT_EQ(ftReleaseDevice(freed_device), FT_ERROR_NONE);
  uint64_t on_stack[8] = {};
  for (const Function& f : functions()) {
    if (f.handle == Handle::none) continue;
    const ApiScene& s = scenes.of(f);
    const bool is_device = f.handle == Handle::device;
    Use use(f.arguments, s.device, s.scene);
    const std::array<void*, 5> bad = {nullptr, on_stack, is_device ? static_cast<void*>(freed_device) : freed_scene,
                                      is_device ? static_cast<void*>(s.scene) : s.device,
                                      std::bit_cast<void*>(~uintptr_t(15))};
    for (size_t k = 0; k < bad.size(); ++k) {
      if (is_device) {
        use.device = static_cast<FTDevice>(bad[k]);
      } else {
        use.scene = static_cast<FTScene>(bad[k]);
      }
      expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, "handle " + std::to_string(k), nullptr);
    }
  }
}

TEST(ApiMisuse, PointersThatAreNullOrMisaligned) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    const FTDevice device = f.handle == Handle::none ? nullptr : s.device;
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      const Argument& a = f.arguments[i];
      Use use(f.arguments, s.device, s.scene);
      void* const valid = use.data[i];
      use.data[i] = nullptr;
      if (!a.may_be_null) expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " is null", device);
      if (a.kind == Kind::text || a.alignment == 1) continue;
      for (const size_t shift : {size_t(1), a.alignment / 2}) {
        use.data[i] = static_cast<char*>(valid) + shift;
        expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " is misaligned", device);
      }
    }
  }
}

TEST(ApiMisuse, StridesThatAreBad) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      const Argument& a = f.arguments[i];
      if (!a.has_stride) continue;
      Use use(f.arguments, s.device, s.scene);
      std::vector<size_t> strides = {size_t(-1), size_t(-4), size_t(-1) / 4 + 1 - 4 * (a.bytes % 2),
                                     size_t(-1) / 2 - 3};
      if (a.bytes > 4) strides.push_back(a.bytes - 4);
      if (a.alignment > 1) strides.push_back(a.bytes + 2), strides.push_back(1);
      for (const size_t stride : strides) {
        use.strides[i] = stride;
        expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " by " + std::to_string(stride), s.device);
      }
    }
  }
  // Rows of pixels.
  float pixels[36] = {};
  for (const size_t stride : {size_t(-1), size_t(-4), size_t(44), size_t(50), size_t(1) << 62, size_t(1) << 63}) {
    EXPECT_EQ(ftRender(scenes.committed->scene, pixels, 0, stride), FT_ERROR_INVALID_ARGUMENT) << stride;
    EXPECT_EQ(ftGetDeviceError(scenes.committed->device, nullptr), FT_ERROR_INVALID_ARGUMENT);
  }
}

TEST(ApiMisuse, ResultsThatOverlap) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      for (size_t k = 0; k < f.arguments.size(); ++k) {
        const Argument &a = f.arguments[i], &b = f.arguments[k];
        if (i == k || a.kind != Kind::result || !a.has_stride || !b.has_stride) continue;
        Use use(f.arguments, s.device, s.scene);
        use.data[i] = use.data[k];
        expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " overlaps " + b.name, s.device);
      }
    }
  }
}

TEST(ApiMisuse, NumbersThatAreNone) {
  const Scenes scenes;
  constexpr float k_nan = std::numeric_limits<float>::quiet_NaN(), k_inf = std::numeric_limits<float>::infinity();
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      const Argument& a = f.arguments[i];
      if (a.kind != Kind::floats) continue;
      for (size_t k = 0; k < a.floats.size() * a.elements; ++k) {
        for (const float bad : {k_nan, k_inf, -k_inf}) {
          if (a.name == "t_max" && bad == bad) continue;  // both are allowed
          Use use(f.arguments, s.device, s.scene);
          static_cast<float*>(use.data[i])[k] = bad;
          expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " " + std::to_string(bad), s.device);
        }
      }
    }
    for (size_t i = 0; i < f.arguments.size(); ++i) {
      const Argument& a = f.arguments[i];
      if (a.kind != Kind::indices) continue;
      Use use(f.arguments, s.device, s.scene);
      static_cast<uint32_t*>(use.data[i])[a.indices.size() * a.elements - 1] = 1000;
      expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, a.name + " 1000", s.device);
    }
  }
}

TEST(ApiMisuse, NoElements) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    Use use(f.arguments, s.device, s.scene);
    use.count = 0;
    if (f.name == "ftAddMesh") expect_error(f, use, FT_ERROR_INVALID_ARGUMENT, "empty", s.device);
    if (!f.is_query) continue;
    EXPECT_EQ(f.call(use), FT_ERROR_NONE) << f.name;
    std::fill(use.data.begin(), use.data.end(), nullptr);
    EXPECT_EQ(f.call(use), FT_ERROR_NONE) << f.name;
  }
}

TEST(ApiMisuse, WrongOrder) {
  const Scenes scenes;
  for (const Function& f : functions()) {
    if (f.order == Order::any) continue;
    const ApiScene& s = f.order == Order::before_commit ? *scenes.committed : *scenes.open;
    const Use use(f.arguments, s.device, s.scene);
    expect_error(f, use, FT_ERROR_INVALID_OPERATION, "wrong order", s.device);
  }
}

// Every function by 8 threads at once on the same objects; queries answer as they do alone.
TEST(ApiMisuse, EachFromEightThreads) {
  const Scenes scenes;
  ASSERT_EQ(ftBakeFields(scenes.committed->scene), FT_ERROR_NONE);
  for (const Function& f : functions()) {
    const ApiScene& s = scenes.of(f);
    const Use alone(f.arguments, s.device, s.scene);
    ASSERT_EQ(f.call(alone), FT_ERROR_NONE) << f.name;
    std::vector<std::thread> threads;
    for (int t = 0; t < k_threads; ++t) {
      threads.emplace_back([&] {
        const Use use(f.arguments, s.device, s.scene);
        for (int round = 0; round < 2; ++round) {
          EXPECT_EQ(f.call(use), FT_ERROR_NONE) << f.name;
          if (f.is_query) {
            EXPECT_EQ(use.memory(), alone.memory()) << f.name;
          }
        }
      });
    }
    for (std::thread& t : threads) t.join();
  }
}

// Threads that begin at different functions of one scene: whatever the others do, a call has the code that it has
// alone.
TEST(ApiMisuse, DifferentOnesFromEightThreads) {
  const auto s = make_scene();
  const std::vector<Function>& all = functions();
  std::vector<std::thread> threads;
  for (int t = 0; t < k_threads; ++t) {
    threads.emplace_back([&, t] {
      for (size_t i = 0; i < all.size(); ++i) {
        const Function& f = all[(i + size_t(t) * 5) % all.size()];
        const FTError expected = f.order == Order::before_commit ? FT_ERROR_INVALID_OPERATION : FT_ERROR_NONE;
        EXPECT_EQ(f.call(Use(f.arguments, s->device, s->scene)), expected) << f.name;
        EXPECT_EQ(ftGetDeviceError(s->device, nullptr), expected) << f.name;
      }
    });
  }
  for (std::thread& t : threads) t.join();
}

// The last reference goes while every one of 8 threads is calling.
TEST(ApiMisuse, EachReleasedWhileInUse) {
  for (const Function& f : functions()) {
    // Not where calls keep the object: references that come and go.
    const auto names = [&](const char* part) { return f.name.find(part) != std::string::npos; };
    if (f.handle == Handle::none || names("Retain") || names("Release")) continue;
    const auto [device, scene] = make_scene(f.order != Order::before_commit)->take();
    std::atomic<int> called = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < k_threads; ++t) {
      threads.emplace_back([&, device = device, scene = scene] {
        const Use use(f.arguments, device, scene);
        EXPECT_EQ(f.call(use), FT_ERROR_NONE) << f.name;
        ++called;
        FTError code = FT_ERROR_NONE;
        while (code == FT_ERROR_NONE) code = f.call(use);
        EXPECT_EQ(code, FT_ERROR_INVALID_ARGUMENT) << f.name;
        EXPECT_EQ(ftGetDeviceError(device, nullptr), FT_ERROR_INVALID_ARGUMENT) << f.name;
      });
    }
    while (called < k_threads) std::this_thread::yield();
    EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
    EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
    for (std::thread& t : threads) t.join();
  }
}

// Changes get their turn however many threads ask without a pause.
TEST(ApiMisuse, ChangesAreNotHeldUpForEver) {
  const auto s = make_scene();
  std::atomic<bool> done = false;
  std::vector<std::thread> threads;
  for (int t = 0; t < k_threads; ++t) {
    threads.emplace_back([&] {
      const std::vector<float> o(6000, 0.3f), d(6000, 0.7f);
      std::vector<uint8_t> results(2000);
      while (!done) {
        EXPECT_EQ(ftOccluded(s->scene, o.data(), 0, d.data(), 0, nullptr, 0, nullptr, 0, 2000, results.data(), 0),
                  FT_ERROR_NONE);
      }
    });
  }
  for (int round = 0; round < 10; ++round) {
    EXPECT_EQ(ftSetInstanceTransform(s->scene, 2, nullptr), FT_ERROR_NONE);
    EXPECT_EQ(ftCommitScene(s->scene), FT_ERROR_NONE);
  }
  done = true;
  for (std::thread& t : threads) t.join();
}

}  // namespace
}  // namespace fieldtrace
