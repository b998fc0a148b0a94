// Pictures through an emulated GPU, for tests.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gpu/device.h"
#include "gpu/emulated.h"
#include "hybrid/render/render.h"

namespace fieldtrace::test {

struct EmulatedPicture {
  RenderResult result;
  std::vector<std::string> warnings;
  gpu::EmulatedLog log;
};

// Renders with a device `emulated` that has these faults.
inline EmulatedPicture render_emulated(const Scene& scene, RenderOptions options,
                                       const gpu::EmulatedFaults& faults = {}) {
  const auto log = std::make_shared<gpu::EmulatedLog>();
  DeviceKind kind;
  kind.name = "emulated";
  kind.open = [&](const DeviceOptions& o) -> std::unique_ptr<VisibilityDevice> {
    return std::make_unique<gpu::GpuDevice>(std::make_unique<gpu::EmulatedRuntime>(faults, log),
                                            std::span<const std::byte>(), o);
  };
  register_device_kind(kind);
  options.device = "emulated";
  EmulatedPicture picture;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& message) { picture.warnings.push_back(message); };
  picture.result = render(scene, options, callbacks);
  picture.log = *log;
  return picture;
}

// Nothing was left behind, and nothing was used wrongly.
inline bool is_clean(const gpu::EmulatedLog& log) {
  return log.allocated == 0 && log.host_allocated == 0 && log.open_devices == 0 && log.streams == 0 && log.misuse == 0;
}

}  // namespace fieldtrace::test
