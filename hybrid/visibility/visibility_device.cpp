#include "hybrid/visibility/visibility_device.h"

#include <map>

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

std::unique_ptr<VisibilityDevice> open_device(const std::string& name, const DeviceOptions& options) {
  if (name == "cpu") return nullptr;
  const DeviceKind kind = device_kind(name);
  try {
    return kind.open(options);
  } catch (const Error& e) {
    warn(options.warning, {}, "--device " + name + ": " + e.what() + "; the CPU answers instead");
    return nullptr;
  }
}

}  // namespace fieldtrace
