#include "gpu/runtime_cuda.h"

#include <dlfcn.h>

#include "core/platform/error.h"
#include "gpu/device_arguments.h"

namespace fieldtrace::gpu {
namespace {

// Of CUDA's headers.
constexpr Status k_out_of_memory = 2, k_invalid_value = 1;
constexpr int k_attribute_compute_major = 75, k_attribute_compute_minor = 76;
constexpr unsigned k_stream_non_blocking = 1, k_event_without_time = 2;
void* const k_argument_buffer = reinterpret_cast<void*>(1);
void* const k_argument_size = reinterpret_cast<void*>(2);

class CudaRuntime final : public Runtime {
 public:
  explicit CudaRuntime(const DriverFunctions& functions) : cu_(functions) {}

  Status list(std::vector<DeviceProperties>& devices) override {
    int count = 0;
    Status status = cu_.Init(0);
    if (!status) status = cu_.DeviceGetCount(&count);
    for (int i = 0; !status && i < count; ++i) status = properties(i, devices.emplace_back());
    return status;
  }

  Status open(int index, std::span<const std::byte> image) override {
    Status status = cu_.DeviceGet(&device_, index);
    if (!status) status = cu_.DevicePrimaryCtxRetain(&context_, device_);
    if (!status) status = enter();
    if (!status) status = cu_.ModuleLoadData(&module_, image.data());
    for (int k = 0; !status && k < k_kernels; ++k) {
      status = cu_.ModuleGetFunction(&functions_[k], module_, k_kernel_names[k]);
    }
    for (int s = 0; !status && s < k_streams; ++s) {
      status = cu_.StreamCreate(&streams_[s], k_stream_non_blocking);
      if (!status) status = cu_.EventCreate(&events_[s], k_event_without_time);
    }
    return status;
  }

  // Goes on after failures; returns the first one.
  Status close() override {
    Status first = k_success;
    const auto note = [&](Status status) { first = first ? first : status; };
    for (int s = 0; s < k_streams; ++s) {
      if (events_[s]) note(cu_.EventDestroy(std::exchange(events_[s], nullptr)));
      if (streams_[s]) note(cu_.StreamDestroy(std::exchange(streams_[s], nullptr)));
    }
    if (module_) note(cu_.ModuleUnload(std::exchange(module_, nullptr)));
    if (std::exchange(context_, nullptr)) note(cu_.DevicePrimaryCtxRelease(device_));
    return first;
  }

  Status enter() override { return cu_.CtxSetCurrent(context_); }

  Status allocate(size_t bytes, DeviceAddress& address) override {
    unsigned long long at = 0;
    const Status status = cu_.MemAlloc(&at, bytes);
    address = at;
    return status;
  }
  Status free(DeviceAddress address) override { return cu_.MemFree(address); }
  Status allocate_host(size_t bytes, void*& memory) override { return cu_.MemHostAlloc(&memory, bytes, 0); }
  Status free_host(void* memory) override { return cu_.MemFreeHost(memory); }

  Status copy_to_device(Stream stream, DeviceAddress to, const void* from, size_t bytes) override {
    return cu_.MemcpyHtoDAsync(to, from, bytes, streams_[stream]);
  }
  Status copy_to_host(Stream stream, void* to, DeviceAddress from, size_t bytes) override {
    return cu_.MemcpyDtoHAsync(to, from, bytes, streams_[stream]);
  }
  Status copy_on_device(Stream stream, DeviceAddress to, DeviceAddress from, size_t bytes) override {
    return cu_.MemcpyDtoDAsync(to, from, bytes, streams_[stream]);
  }
  Status fill_zero(Stream stream, DeviceAddress address, size_t bytes) override {
    return cu_.MemsetD8Async(address, 0, bytes, streams_[stream]);
  }

  Status launch(Stream stream, Kernel kernel, uint32_t blocks, const void* arguments, size_t bytes) override {
    if (blocks == 0) return k_invalid_value;
    void* extra[] = {k_argument_buffer, const_cast<void*>(arguments), k_argument_size, &bytes, nullptr};
    return cu_.LaunchKernel(functions_[int(kernel)], blocks, 1, 1, k_warp, 1, 1, 0, streams_[stream], nullptr, extra);
  }
  Status follow(Stream stream, Stream other) override {
    const Status status = cu_.EventRecord(events_[other], streams_[other]);
    return status ? status : cu_.StreamWaitEvent(streams_[stream], events_[other], 0);
  }
  // Without a stream nothing was started.
  Status synchronise(Stream stream) override {
    return streams_[stream] ? cu_.StreamSynchronize(streams_[stream]) : k_success;
  }

  bool out_of_memory(Status status) const override { return status == k_out_of_memory; }
  std::string describe(Status status) const override {
    const char* text = nullptr;
    if (cu_.GetErrorString(status, &text) || !text) text = "unknown error";
    return std::string(text) + " (CUDA error " + std::to_string(status) + ")";
  }

 private:
  Status properties(int index, DeviceProperties& p) const {
    int device = 0;
    char name[256] = {};
    size_t bytes = 0;
    Status status = cu_.DeviceGet(&device, index);
    if (!status) status = cu_.DeviceGetName(name, int(sizeof name) - 1, device);
    if (!status) status = cu_.DeviceGetAttribute(&p.compute_major, k_attribute_compute_major, device);
    if (!status) status = cu_.DeviceGetAttribute(&p.compute_minor, k_attribute_compute_minor, device);
    if (!status) status = cu_.DeviceTotalMem(&bytes, device);
    p.name = name;
    p.memory = bytes;
    return status;
  }

  const DriverFunctions cu_;
  int device_ = 0;
  DriverHandle context_ = nullptr, module_ = nullptr;
  DriverHandle streams_[k_streams] = {}, events_[k_streams] = {};
  DriverHandle functions_[k_kernels] = {};
};

template <class Function>
void load(void* library, const char* name, Function& function) {
  void* const address = dlsym(library, name);
  if (!address) throw Error(std::string("CUDA's driver is too old: it lacks the function ") + name);
  function = reinterpret_cast<Function>(address);
}

}  // namespace

// The library stays open: the driver's threads may run until the process ends.
std::unique_ptr<Runtime> open_cuda_runtime(const std::string& library) {
  void* const driver = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!driver) {
    const char* const reason = dlerror();
    throw Error("this machine has no CUDA driver (" + std::string(reason ? reason : library) + ")");
  }
  DriverFunctions f;
  load(driver, "cuInit", f.Init);
  load(driver, "cuGetErrorString", f.GetErrorString);
  load(driver, "cuDeviceGetCount", f.DeviceGetCount);
  load(driver, "cuDeviceGet", f.DeviceGet);
  load(driver, "cuDeviceGetName", f.DeviceGetName);
  load(driver, "cuDeviceGetAttribute", f.DeviceGetAttribute);
  load(driver, "cuDeviceTotalMem_v2", f.DeviceTotalMem);
  load(driver, "cuDevicePrimaryCtxRetain", f.DevicePrimaryCtxRetain);
  load(driver, "cuDevicePrimaryCtxRelease_v2", f.DevicePrimaryCtxRelease);
  load(driver, "cuCtxSetCurrent", f.CtxSetCurrent);
  load(driver, "cuModuleLoadData", f.ModuleLoadData);
  load(driver, "cuModuleUnload", f.ModuleUnload);
  load(driver, "cuModuleGetFunction", f.ModuleGetFunction);
  load(driver, "cuMemAlloc_v2", f.MemAlloc);
  load(driver, "cuMemFree_v2", f.MemFree);
  load(driver, "cuMemHostAlloc", f.MemHostAlloc);
  load(driver, "cuMemFreeHost", f.MemFreeHost);
  load(driver, "cuMemcpyHtoDAsync_v2", f.MemcpyHtoDAsync);
  load(driver, "cuMemcpyDtoHAsync_v2", f.MemcpyDtoHAsync);
  load(driver, "cuMemcpyDtoDAsync_v2", f.MemcpyDtoDAsync);
  load(driver, "cuMemsetD8Async", f.MemsetD8Async);
  load(driver, "cuStreamCreate", f.StreamCreate);
  load(driver, "cuStreamDestroy_v2", f.StreamDestroy);
  load(driver, "cuStreamSynchronize", f.StreamSynchronize);
  load(driver, "cuStreamWaitEvent", f.StreamWaitEvent);
  load(driver, "cuEventCreate", f.EventCreate);
  load(driver, "cuEventRecord", f.EventRecord);
  load(driver, "cuEventDestroy_v2", f.EventDestroy);
  load(driver, "cuLaunchKernel", f.LaunchKernel);
  return std::make_unique<CudaRuntime>(f);
}

}  // namespace fieldtrace::gpu
