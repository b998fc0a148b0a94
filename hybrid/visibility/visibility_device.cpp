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

SegmentCounts CpuDevice::query(const Field&, const SegmentTask& task, const RayBatch& rays, const LightRaySource&,
                               const uint32_t* shading_point_instance, std::span<const uint32_t> blocks,
                               int32_t candidate_slot, RayStates& states) {
  SegmentCounts counts;
  for (size_t i = 0, next = 0; i < blocks.size(); i = next) {
    for (next = i + 1; next < blocks.size() && blocks[next] == blocks[next - 1] + k_batch_padding;) ++next;
    const SegmentCounts run = kernels_.query(task, rays, shading_point_instance, blocks[i],
                                             blocks[next - 1] + k_batch_padding, candidate_slot, states);
    counts.crossings += run.crossings;
    counts.lookups += run.lookups;
  }
  return counts;
}

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
