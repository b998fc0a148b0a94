#include "hybrid/visibility/visibility_device.h"

#include <map>
#include <system_error>

namespace fieldtrace {
namespace {

// Kinds register themselves before main() from files that nobody includes.
std::map<std::string, DeviceKind>& registry() {
  static std::map<std::string, DeviceKind> kinds;
  return kinds;
}

}  // namespace

bool register_device_kind(DeviceKind kind) {
  registry()[kind.name] = std::move(kind);
  return true;
}

std::vector<DeviceKind> device_kinds() {
  std::vector<DeviceKind> kinds;
  for (const auto& [name, kind] : registry()) kinds.push_back(kind);
  return kinds;
}

DeviceKind device_kind(const std::string& name) {
  const auto found = registry().find(name);
  if (found == registry().end()) {
    throw UsageError("--device " + name + ": not available yet: this program was built without it");
  }
  const DeviceKind& kind = found->second;
  if (!kind.lacks.empty()) throw UsageError("--device " + name + ": not available yet: " + kind.lacks);
  return kind;
}

OpeningDevice::OpeningDevice(const std::string& name, const DeviceOptions& options)
    : name_(name), warning_(options.warning) {
  if (name == "cpu") return;
  const auto open = [kind = device_kind(name), options] { return kind.open(options); };
  try {
    opening_ = std::async(std::launch::async, open);
  } catch (const std::system_error&) {
    opening_ = std::async(std::launch::deferred, open);  // no further thread can be started
  }
}

VisibilityDevice* OpeningDevice::get() {
  if (!opening_.valid()) return device_.get();
  try {
    device_ = opening_.get();
  } catch (const std::exception& e) {
    warn(warning_, {}, "--device " + name_ + ": " + e.what() + "; the CPU answers instead");
  }
  return device_.get();
}

}  // namespace fieldtrace
