// The C interface (fieldtrace.h) for C++17: handles that release themselves, and errors as exceptions.
//
// Every other function is called on Scene::get(), within check(). Thread-safety: as fieldtrace.h; one Device or Scene
// object, like a shared_ptr, belongs to one thread at a time.
#pragma once

#include <fieldtrace/fieldtrace.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace ft {

// what() is the library's message.
class Error : public std::runtime_error {
 public:
  Error(FTError code, const std::string& message) : std::runtime_error(message), code_(code) {}
  FTError code() const { return code_; }

 private:
  FTError code_;
};

// Throws Error unless `code` is FT_ERROR_NONE. `device`: that the call was made on, or null.
inline void check(FTError code, FTDevice device) {
  if (code == FT_ERROR_NONE) return;
  const char* message = "";
  if (ftGetDeviceError(device, &message) != code) ftGetDeviceError(nullptr, &message);
  throw Error(code, message);
}

class Device {
 public:
  explicit Device(uint32_t threads = 0) { check(ftNewDevice(threads, &device_), nullptr); }
  Device(const Device& other) : device_(other.device_) { ftRetainDevice(device_); }
  Device(Device&& other) noexcept : device_(std::exchange(other.device_, nullptr)) {}
  Device& operator=(Device other) noexcept {
    std::swap(device_, other.device_);
    return *this;
  }
  ~Device() {
    if (device_) ftReleaseDevice(device_);
  }
  FTDevice get() const { return device_; }

 private:
  FTDevice device_ = nullptr;
};

class Scene {
 public:
  explicit Scene(Device device) : device_(std::move(device)) { check(ftNewScene(device_.get(), &scene_)); }
  Scene(Device device, const std::string& path) : device_(std::move(device)) {
    check(ftLoadScene(device_.get(), path.c_str(), &scene_));
  }
  Scene(const Scene& other) : device_(other.device_), scene_(other.scene_) { ftRetainScene(scene_); }
  Scene(Scene&& other) noexcept : device_(std::move(other.device_)), scene_(std::exchange(other.scene_, nullptr)) {}
  Scene& operator=(Scene other) noexcept {
    std::swap(device_, other.device_);
    std::swap(scene_, other.scene_);
    return *this;
  }
  ~Scene() {
    if (scene_) ftReleaseScene(scene_);
  }
  FTScene get() const { return scene_; }
  void check(FTError code) const { ft::check(code, device_.get()); }

  uint32_t add_mesh(const float* positions, size_t position_count, const uint32_t* triangles, size_t triangle_count) {
    uint32_t mesh = FT_NO_MESH;
    check(ftAddMesh(scene_, positions, 0, position_count, triangles, 0, triangle_count, &mesh));
    return mesh;
  }
  uint32_t add_instance(uint32_t mesh, const float* transform = nullptr) {
    uint32_t instance = FT_NO_INSTANCE;
    check(ftAddInstance(scene_, mesh, transform, &instance));
    return instance;
  }
  void set_transform(uint32_t instance, const float* transform) {
    check(ftSetInstanceTransform(scene_, instance, transform));
  }
  void set(const char* name, int64_t value) { check(ftSetSceneInt(scene_, name, value)); }
  void set_float(const char* name, double value) { check(ftSetSceneFloat(scene_, name, value)); }
  int64_t get_int(const char* name) const {
    int64_t value = 0;
    check(ftGetSceneInt(scene_, name, &value));
    return value;
  }
  void commit() { check(ftCommitScene(scene_)); }
  void bake() { check(ftBakeFields(scene_)); }
  // Packed arrays; results[i] is FT_CLEAR or FT_BLOCKED.
  void occluded(const float* origins, const float* directions, const float* t_max, size_t count,
                uint8_t* results) const {
    check(ftOccluded(scene_, origins, 0, directions, 0, t_max, 0, nullptr, 0, count, results, 0));
  }
  // width x height x RGB floats.
  void render(float* pixels) const { check(ftRender(scene_, pixels, 0, 0)); }

 private:
  Device device_;
  FTScene scene_ = nullptr;
};

}  // namespace ft
