// Registers the kind of device `cuda`.
#include "gpu/device.h"
#include "gpu/runtime_cuda.h"

// The kernels, compiled for every architecture (gpu/CMakeLists.txt); empty where no CUDA compiler was found.
extern "C" const std::byte fieldtrace_kernels[];
extern "C" const uint64_t fieldtrace_kernels_bytes;

namespace fieldtrace::gpu {
namespace {

std::span<const std::byte> kernels() { return {fieldtrace_kernels, size_t(fieldtrace_kernels_bytes)}; }

DeviceKind cuda_kind() {
  DeviceKind kind;
  kind.name = "cuda";
  if (kernels().empty()) kind.lacks = "this program was built without kernels for GPUs";
  kind.list = [] {
    try {
      return list_devices(*open_cuda_runtime());
    } catch (const Error& e) {
      return std::vector<std::string>{std::string("none: ") + e.what()};
    }
  };
  kind.open = [](const DeviceOptions& options) -> std::unique_ptr<VisibilityDevice> {
    return std::make_unique<GpuDevice>(open_cuda_runtime(), kernels(), options);
  };
  return kind;
}

[[maybe_unused]] const bool k_registered = register_device_kind(cuda_kind());

}  // namespace
}  // namespace fieldtrace::gpu
