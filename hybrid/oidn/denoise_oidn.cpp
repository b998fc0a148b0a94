#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "hybrid/denoise/denoiser.h"
#include "hybrid/oidn/oidn_api.h"

namespace fieldtrace {
namespace {

struct Release {
  void operator()(OIDNDeviceImpl* device) const { oidnReleaseDevice(device); }
  void operator()(OIDNFilterImpl* filter) const { oidnReleaseFilter(filter); }
};
using Device = std::unique_ptr<OIDNDeviceImpl, Release>;
using Filter = std::unique_ptr<OIDNFilterImpl, Release>;

void throw_if_failed(OIDNDeviceImpl* device) {
  const char* message = nullptr;
  if (oidnGetDeviceError(device, &message) == 0) return;
  throw std::runtime_error(message && *message ? message : "Open Image Denoise gives no reason");
}

Device open_device(int threads) {
  // The CPU's, so that a GPU's driver decides nothing about the picture.
  Device device(oidnNewDevice(k_oidn_cpu));
  throw_if_failed(device.get());
  if (!device) throw std::runtime_error("Open Image Denoise does not support this processor");
  if (threads > 0) oidnSetDeviceInt(device.get(), "numThreads", threads);
  oidnSetDeviceBool(device.get(), "setAffinity", false);
  oidnCommitDevice(device.get());
  throw_if_failed(device.get());
  return device;
}

struct NamedImage {
  const char* name;
  float* pixels;
};

void filter(OIDNDeviceImpl* device, const DenoiserInput& input, std::initializer_list<NamedImage> images,
            std::initializer_list<const char*> flags) {
  const Filter made(oidnNewFilter(device, "RT"));
  throw_if_failed(device);
  for (const NamedImage& image : images) {
    oidnSetSharedFilterImage(made.get(), image.name, image.pixels, k_oidn_float3, size_t(input.width),
                             size_t(input.height), 0, 0, 0);
  }
  for (const char* flag : flags) oidnSetFilterBool(made.get(), flag, true);
  oidnCommitFilter(made.get());
  throw_if_failed(device);
  oidnExecuteFilter(made.get());
  throw_if_failed(device);
}

}  // namespace

extern "C" void fieldtrace_denoise(const DenoiserInput& input, std::string& name) {
  const Device device = open_device(input.threads);
  const int version = oidnGetDeviceInt(device.get(), "version");
  name = "Intel Open Image Denoise " + std::to_string(version / 10000) + "." + std::to_string(version / 100 % 100) +
         "." + std::to_string(version % 100);
  if (input.noisy_layers) {
    filter(device.get(), input, {{"albedo", input.albedo}, {"output", input.albedo}}, {});
    filter(device.get(), input, {{"normal", input.normal}, {"output", input.normal}}, {});
  }
  filter(device.get(), input,
         {{"color", input.colour}, {"albedo", input.albedo}, {"normal", input.normal}, {"output", input.result}},
         {"hdr", "cleanAux"});
}

// The program calls it by this type.
static_assert(std::is_same_v<decltype(fieldtrace_denoise), Denoiser>);

}  // namespace fieldtrace
