// The objects behind the handles of fieldtrace/fieldtrace.h, and the boundary that no exception crosses.
//
// A handle is a number that is never used twice, so that a freed one is found out. Thread-safety: every function may be
// called from any thread; calls share an object with its registry entry, so a release never frees it under them.
#pragma once

#include <tbb/task_arena.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "core/platform/error.h"
#include "fieldtrace/fieldtrace.h"

namespace fieldtrace::api {

// What a function returns, with its message.
class Failure : public std::runtime_error {
 public:
  Failure(FTError code, const std::string& message) : std::runtime_error(message), code_(code) {}
  FTError code() const { return code_; }

 private:
  FTError code_;
};

// Throws Failure(FT_ERROR_INVALID_ARGUMENT) unless `holds`.
inline void require(bool holds, const std::string& message) {
  if (!holds) throw Failure(FT_ERROR_INVALID_ARGUMENT, message);
}

// Throws Failure(FT_ERROR_INVALID_ARGUMENT) unless a T can be written there.
template <class T>
void require_place(const T* result, const std::string& name) {
  require(result != nullptr, name + ": nowhere to put it");
  require(reinterpret_cast<uintptr_t>(result) % alignof(T) == 0, name + ": the pointer to it is not aligned");
}

struct Device {
  explicit Device(int threads) : arena(threads) {}

  tbb::task_arena arena;
  std::mutex mutex;           // of the callbacks
  std::mutex progress_mutex;  // held while the progress callback runs
  std::mutex warning_mutex;   // held while the warning callback runs
  FTErrorCallback on_error = nullptr;
  FTProgressCallback on_progress = nullptr;
  FTWarningCallback on_warning = nullptr;
  void* error_user = nullptr;
  void* progress_user = nullptr;
  void* warning_user = nullptr;
  uintptr_t handle = 0;  // set once registered
};

struct SceneObject;  // scene_object.h

uintptr_t register_object(std::shared_ptr<Device> device);
uintptr_t register_object(std::shared_ptr<SceneObject> scene);
void retain(uintptr_t handle, bool is_scene);
void release(uintptr_t handle, bool is_scene);
// Throws Failure for handles that are null, freed or of the other kind.
std::shared_ptr<Device> find(FTDevice device);
std::shared_ptr<SceneObject> find(FTScene scene);
// Null instead of an error.
std::shared_ptr<Device> device_or_null(FTDevice device) noexcept;
std::shared_ptr<Device> device_of(FTScene scene) noexcept;

// Hands warnings to the device's callback, if it has one. `device` must outlive it.
WarningSink warnings_of(Device& device);
// Keeps the error for ftGetDeviceError() of this thread and calls the error callback. `device` may be null.
FTError report(const std::shared_ptr<Device>& device, FTError code, const char* message) noexcept;
// Code and message of the exception being handled.
FTError report_exception(const std::shared_ptr<Device>& device) noexcept;

// Calls body() and turns exceptions into errors of `device`, which may be null.
template <class Body>
FTError guarded(const std::shared_ptr<Device>& device, const Body& body) noexcept {
  try {
    body();
    return FT_ERROR_NONE;
  } catch (...) {
    return report_exception(device);
  }
}

// The same with the scene of a handle: body(SceneObject&).
template <class Body>
FTError guarded(FTScene scene, const Body& body) noexcept {
  return guarded(device_of(scene), [&] {
    const std::shared_ptr<SceneObject> object = find(scene);
    body(*object);
  });
}

}  // namespace fieldtrace::api
