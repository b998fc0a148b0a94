#include "hybrid/api/api_objects.h"

#include <bit>
#include <map>
#include <new>
#include <variant>

#include "hybrid/api/scene_object.h"

namespace fieldtrace::api {
namespace {

struct Entry {
  std::variant<std::shared_ptr<Device>, std::shared_ptr<SceneObject>> object;
  uint64_t references = 1;
};

struct Registry {
  std::mutex mutex;
  std::map<uintptr_t, Entry> entries;
  uintptr_t next = 16;
};

// Never destroyed: handles may be released by static objects of the caller.
Registry& registry() {
  static Registry* const r = new Registry;
  return *r;
}

// Errors of one thread, by device; 0: those of no device.
struct LastError {
  FTError code = FT_ERROR_NONE;
  std::string message;
};
thread_local std::map<uintptr_t, LastError> t_errors;
thread_local std::string t_message;

template <class Object>
uintptr_t add(std::shared_ptr<Object> object) {
  Registry& r = registry();
  const std::lock_guard lock(r.mutex);
  const uintptr_t handle = r.next;
  r.entries.emplace(handle, Entry{std::move(object), 1});
  r.next += 16;
  return handle;
}

// Null if there is none of that kind.
template <class Object>
std::shared_ptr<Object> look_up(uintptr_t handle) {
  Registry& r = registry();
  const std::lock_guard lock(r.mutex);
  const auto entry = r.entries.find(handle);
  if (entry == r.entries.end()) return nullptr;
  const auto* const object = std::get_if<std::shared_ptr<Object>>(&entry->second.object);
  return object ? *object : nullptr;
}

const char* no_handle(uintptr_t handle, bool is_scene) {
  if (handle == 0) return is_scene ? "the scene is null" : "the device is null";
  return is_scene ? "the scene was released, or is no scene" : "the device was released, or is no device";
}

Entry& entry_of(Registry& r, uintptr_t handle, bool is_scene) {
  const auto entry = r.entries.find(handle);
  require(entry != r.entries.end() && (entry->second.object.index() == 1) == is_scene, no_handle(handle, is_scene));
  return entry->second;
}

}  // namespace

uintptr_t register_object(std::shared_ptr<Device> device) {
  Device& d = *device;
  return d.handle = add(std::move(device));
}
uintptr_t register_object(std::shared_ptr<SceneObject> scene) { return add(std::move(scene)); }

void retain(uintptr_t handle, bool is_scene) {
  Registry& r = registry();
  const std::lock_guard lock(r.mutex);
  ++entry_of(r, handle, is_scene).references;
}

void release(uintptr_t handle, bool is_scene) {
  Entry last;  // destroyed without the lock
  Registry& r = registry();
  const std::lock_guard lock(r.mutex);
  Entry& entry = entry_of(r, handle, is_scene);
  if (--entry.references > 0) return;
  std::swap(last, entry);
  r.entries.erase(handle);
}

std::shared_ptr<Device> find(FTDevice device) {
  const auto handle = reinterpret_cast<uintptr_t>(device);
  std::shared_ptr<Device> object = look_up<Device>(handle);
  require(object != nullptr, no_handle(handle, false));
  return object;
}

std::shared_ptr<SceneObject> find(FTScene scene) {
  const auto handle = reinterpret_cast<uintptr_t>(scene);
  std::shared_ptr<SceneObject> object = look_up<SceneObject>(handle);
  require(object != nullptr, no_handle(handle, true));
  return object;
}

std::shared_ptr<Device> device_or_null(FTDevice device) noexcept {
  return look_up<Device>(reinterpret_cast<uintptr_t>(device));
}

std::shared_ptr<Device> device_of(FTScene scene) noexcept {
  const std::shared_ptr<SceneObject> object = look_up<SceneObject>(reinterpret_cast<uintptr_t>(scene));
  return object ? object->device : nullptr;
}

WarningSink warnings_of(Device& device) {
  return [&device](const std::string& message) {
    FTWarningCallback callback = nullptr;
    void* user = nullptr;
    {
      const std::lock_guard lock(device.mutex);
      callback = device.on_warning, user = device.warning_user;
    }
    if (!callback) return;
    const std::lock_guard lock(device.warning_mutex);
    callback(user, message.c_str());
  };
}

FTError report(const std::shared_ptr<Device>& device, FTError code, const char* message) noexcept {
  FTErrorCallback callback = nullptr;
  void* user = nullptr;
  try {
    t_errors[device ? device->handle : 0] = {code, message};
    if (device) {
      const std::lock_guard lock(device->mutex);
      callback = device->on_error, user = device->error_user;
    }
  } catch (...) {
    // Without memory for the message, the code is returned all the same.
  }
  if (callback) callback(user, code, message);
  return code;
}

FTError report_exception(const std::shared_ptr<Device>& device) noexcept {
  try {
    throw;
  } catch (const Failure& e) {
    return report(device, e.code(), e.what());
  } catch (const Error& e) {
    return report(device, FT_ERROR_INPUT, e.what());
  } catch (const UsageError& e) {
    return report(device, FT_ERROR_INVALID_ARGUMENT, e.what());
  } catch (const std::bad_alloc&) {
    return report(device, FT_ERROR_OUT_OF_MEMORY, "out of memory");
  } catch (const std::exception& e) {
    return report(device, FT_ERROR_UNKNOWN, e.what());
  } catch (...) {
    return report(device, FT_ERROR_UNKNOWN, "unknown error");
  }
}

}  // namespace fieldtrace::api

using namespace fieldtrace::api;

uint32_t ftGetVersion(void) { return 10000 * FT_VERSION_MAJOR + 100 * FT_VERSION_MINOR + FT_VERSION_PATCH; }

FTError ftNewDevice(uint32_t threads, FTDevice* device) {
  return guarded(std::shared_ptr<Device>(), [&] {
    constexpr uint32_t k_most_threads = 1024;
    require_place(device, "ftNewDevice: the device");
    require(threads <= k_most_threads, "ftNewDevice: more than 1024 threads");
    const int count = threads > 0 ? int(threads) : tbb::task_arena::automatic;
    *device = std::bit_cast<FTDevice>(register_object(std::make_shared<Device>(count)));
  });
}

FTError ftRetainDevice(FTDevice device) {
  return guarded(device_or_null(device), [&] { retain(reinterpret_cast<uintptr_t>(device), false); });
}

FTError ftReleaseDevice(FTDevice device) {
  return guarded(device_or_null(device), [&] { release(reinterpret_cast<uintptr_t>(device), false); });
}

FTError ftGetDeviceError(FTDevice device, const char** message) {
  const std::shared_ptr<Device> of = device_or_null(device);
  if (reinterpret_cast<uintptr_t>(message) % alignof(const char*) != 0)
    return report(of, FT_ERROR_INVALID_ARGUMENT, "ftGetDeviceError: the pointer to the message is not aligned");
  // Of a device that was freed between an error and this call, too.
  auto error = t_errors.find(reinterpret_cast<uintptr_t>(device));
  if (error == t_errors.end() && !of) error = t_errors.find(0);
  LastError last;
  if (error != t_errors.end()) {
    last = std::move(error->second);
    t_errors.erase(error);
  }
  t_message = std::move(last.message);
  if (message) *message = t_message.c_str();
  return last.code;
}

FTError ftSetDeviceErrorCallback(FTDevice device, FTErrorCallback callback, void* user) {
  return guarded(device_or_null(device), [&] {
    const std::shared_ptr<Device> d = find(device);
    const std::lock_guard lock(d->mutex);
    d->on_error = callback, d->error_user = user;
  });
}

FTError ftSetDeviceProgressCallback(FTDevice device, FTProgressCallback callback, void* user) {
  return guarded(device_or_null(device), [&] {
    const std::shared_ptr<Device> d = find(device);
    const std::lock_guard lock(d->mutex);
    d->on_progress = callback, d->progress_user = user;
  });
}

FTError ftSetDeviceWarningCallback(FTDevice device, FTWarningCallback callback, void* user) {
  return guarded(device_or_null(device), [&] {
    const std::shared_ptr<Device> d = find(device);
    const std::lock_guard lock(d->mutex);
    d->on_warning = callback, d->warning_user = user;
  });
}

FTError ftRetainScene(FTScene scene) {
  return guarded(device_of(scene), [&] { retain(reinterpret_cast<uintptr_t>(scene), true); });
}

FTError ftReleaseScene(FTScene scene) {
  return guarded(device_of(scene), [&] { release(reinterpret_cast<uintptr_t>(scene), true); });
}
