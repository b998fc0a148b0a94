// The run-time layer over CUDA's driver, by a library that stands for the driver: what is opened is closed, and a whole
// picture equals the CPU's. The types of the driver's functions are those of cuda.h.
#include <cuda.h>
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <type_traits>

#include "gpu/runtime_cuda.h"
#include "tests/gpu/emulated_device.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace::gpu {
namespace {

// A parameter's type as runtime_cuda.h writes it: handles are void*, enumerations int.
template <class T>
struct Plain {
  using type = std::conditional_t<std::is_enum_v<T>, int, T>;
};
template <class T>
requires std::is_class_v<T>
struct Plain<T*> {
  using type = void*;
};
template <class T>
struct Plain<T**> {
  using type = std::conditional_t<std::is_class_v<T>, void**, T**>;
};
template <class R, class... P>
struct Plain<R(P...)> {
  using type = int (*)(typename Plain<P>::type...);
};

#define EXPECT_TYPE(member, function) \
  static_assert(std::is_same_v<decltype(DriverFunctions::member), Plain<decltype(function)>::type>)
EXPECT_TYPE(Init, cuInit);
EXPECT_TYPE(GetErrorString, cuGetErrorString);
EXPECT_TYPE(DeviceGetCount, cuDeviceGetCount);
EXPECT_TYPE(DeviceGet, cuDeviceGet);
EXPECT_TYPE(DeviceGetName, cuDeviceGetName);
EXPECT_TYPE(DeviceGetAttribute, cuDeviceGetAttribute);
EXPECT_TYPE(DeviceTotalMem, cuDeviceTotalMem);
EXPECT_TYPE(DevicePrimaryCtxRetain, cuDevicePrimaryCtxRetain);
EXPECT_TYPE(DevicePrimaryCtxRelease, cuDevicePrimaryCtxRelease);
EXPECT_TYPE(CtxSetCurrent, cuCtxSetCurrent);
EXPECT_TYPE(ModuleLoadData, cuModuleLoadData);
EXPECT_TYPE(ModuleUnload, cuModuleUnload);
EXPECT_TYPE(ModuleGetFunction, cuModuleGetFunction);
EXPECT_TYPE(MemAlloc, cuMemAlloc);
EXPECT_TYPE(MemFree, cuMemFree);
EXPECT_TYPE(MemHostAlloc, cuMemHostAlloc);
EXPECT_TYPE(MemFreeHost, cuMemFreeHost);
EXPECT_TYPE(MemcpyHtoDAsync, cuMemcpyHtoDAsync);
EXPECT_TYPE(MemcpyDtoHAsync, cuMemcpyDtoHAsync);
EXPECT_TYPE(MemcpyDtoDAsync, cuMemcpyDtoDAsync);
EXPECT_TYPE(MemsetD8Async, cuMemsetD8Async);
EXPECT_TYPE(StreamCreate, cuStreamCreate);
EXPECT_TYPE(StreamDestroy, cuStreamDestroy);
EXPECT_TYPE(StreamSynchronize, cuStreamSynchronize);
EXPECT_TYPE(StreamWaitEvent, cuStreamWaitEvent);
EXPECT_TYPE(EventCreate, cuEventCreate);
EXPECT_TYPE(EventRecord, cuEventRecord);
EXPECT_TYPE(EventDestroy, cuEventDestroy);
EXPECT_TYPE(LaunchKernel, cuLaunchKernel);
#undef EXPECT_TYPE

void run_kernel(int kernel, unsigned blocks, const void* arguments) {
  run_emulated_kernel(Kernel(kernel), blocks, arguments);
}

std::span<const std::byte> image(const char* text) { return std::as_bytes(std::span(text, std::strlen(text) + 1)); }

TEST(CudaRuntime, WithoutADriverSaysSo) {
  try {
    open_cuda_runtime("libfieldtrace_has_no_such_driver.so");
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("this machine has no CUDA driver (libfieldtrace_has"), std::string::npos);
  }
  try {
    open_cuda_runtime("libm.so.6");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(std::string(e.what()), "CUDA's driver is too old: it lacks the function cuInit");
  }
}

class EmulatedDriver : public ::testing::Test {
 protected:
  EmulatedDriver() {
    void* const library = dlopen(FIELDTRACE_EMULATED_DRIVER, RTLD_NOW);
    reinterpret_cast<void (*)(void (*)(int, unsigned, const void*))>(dlsym(library, "emulated_driver_run"))(run_kernel);
    left_ = reinterpret_cast<int (*)()>(dlsym(library, "emulated_driver_left"));
  }
  void register_kind(const char* kernels) {
    DeviceKind kind;
    kind.name = "driver";
    kind.open = [kernels](const DeviceOptions& o) -> std::unique_ptr<VisibilityDevice> {
      return std::make_unique<GpuDevice>(open_cuda_runtime(FIELDTRACE_EMULATED_DRIVER), image(kernels), o);
    };
    register_device_kind(kind);
  }
  int (*left_)() = nullptr;
};

TEST_F(EmulatedDriver, ListsItsDevices) {
  const std::vector<std::string> lines = list_devices(*open_cuda_runtime(FIELDTRACE_EMULATED_DRIVER));
  EXPECT_EQ(lines, std::vector<std::string>{"0: Driver of a test, compute capability 8.9, 1073 MB"});
}

TEST_F(EmulatedDriver, RendersTheCpusPicture) {
  const test::HybridScene s = test::hybrid_scenes(24).front();
  RenderOptions o;
  o.spp = 1;
  o.light_samples = 16;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  const RenderResult cpu = render(s.scene, o);
  register_kind("kernels");
  o.device = "driver";
  std::vector<std::string> warnings;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& message) { warnings.push_back(message); };
  const RenderResult device = render(s.scene, o, callbacks);
  EXPECT_EQ(device.image.data, cpu.image.data);
  EXPECT_GT(device.stats.device_blocks, 0u);
  EXPECT_TRUE(warnings.empty()) << warnings[0];
  EXPECT_EQ(left_(), 0);
  register_kind("of another architecture");
  EXPECT_EQ(render(s.scene, o, callbacks).image.data, cpu.image.data);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0],
            "--device driver: opening Driver of a test: other (CUDA error 209); the CPU answers "
            "instead");
  EXPECT_EQ(left_(), 0);
}

}  // namespace
}  // namespace fieldtrace::gpu
