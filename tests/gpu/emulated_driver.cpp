// A library with the functions of CUDA's driver that gpu/runtime_cuda.cpp calls, over host memory. cuda.h checks that
// they are declared as the driver's are. Kernels are run by a function that the test sets; work is done at once.
#include <cuda.h>

#include <cstdlib>
#include <cstring>
#include <string>

namespace {

struct State {
  void (*run)(int kernel, unsigned blocks, const void* arguments) = nullptr;
  int allocated = 0, contexts = 0, modules = 0, streams = 0, events = 0;
  size_t image_size = 0;
} state;

// Handles are any addresses that are not null.
template <class Handle>
Handle handle(int i) {
  return reinterpret_cast<Handle>(size_t(i) + 16);
}

}  // namespace

extern "C" {

__attribute__((visibility("default"))) void emulated_driver_run(void (*run)(int, unsigned, const void*)) {
  state.run = run;
}
__attribute__((visibility("default"))) int emulated_driver_left() {
  return state.allocated + state.contexts + state.modules + state.streams + state.events;
}

CUresult cuInit(unsigned) { return CUDA_SUCCESS; }
CUresult cuGetErrorString(CUresult error, const char** text) {
  *text = error == CUDA_ERROR_INVALID_VALUE ? "invalid argument" : "other";
  return CUDA_SUCCESS;
}
CUresult cuDeviceGetCount(int* count) {
  *count = 1;
  return CUDA_SUCCESS;
}
CUresult cuDeviceGet(CUdevice* device, int ordinal) {
  *device = ordinal + 7;
  return CUDA_SUCCESS;
}
CUresult cuDeviceGetName(char* name, int length, CUdevice device) {
  if (device != 7) return CUDA_ERROR_INVALID_DEVICE;
  std::strncpy(name, "Driver of a test", size_t(length));
  return CUDA_SUCCESS;
}
CUresult cuDeviceGetAttribute(int* value, CUdevice_attribute attribute, CUdevice) {
  *value = attribute == CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR   ? 8
           : attribute == CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR ? 9
                                                                       : -1;
  return CUDA_SUCCESS;
}
CUresult cuDeviceTotalMem(size_t* bytes, CUdevice) {
  *bytes = size_t(1) << 30;
  return CUDA_SUCCESS;
}
CUresult cuDevicePrimaryCtxRetain(CUcontext* context, CUdevice) {
  ++state.contexts;
  *context = handle<CUcontext>(1);
  return CUDA_SUCCESS;
}
CUresult cuDevicePrimaryCtxRelease(CUdevice) {
  --state.contexts;
  return CUDA_SUCCESS;
}
CUresult cuCtxSetCurrent(CUcontext context) {
  return context == handle<CUcontext>(1) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_CONTEXT;
}
CUresult cuModuleLoadData(CUmodule* module, const void* image) {
  if (std::strcmp(static_cast<const char*>(image), "kernels")) return CUDA_ERROR_NO_BINARY_FOR_GPU;
  ++state.modules;
  *module = handle<CUmodule>(2);
  return CUDA_SUCCESS;
}
CUresult cuModuleUnload(CUmodule) {
  --state.modules;
  return CUDA_SUCCESS;
}
CUresult cuModuleGetFunction(CUfunction* function, CUmodule module, const char* name) {
  const std::string names[] = {"light_cones", "filter_strata", "query",       "scatter",
                               "light_rays",  "sky_cells",     "filter_lobes"};
  if (module != handle<CUmodule>(2)) return CUDA_ERROR_INVALID_HANDLE;
  for (int i = 0; i < int(std::size(names)); ++i) {
    if (names[i] != name) continue;
    *function = handle<CUfunction>(i);
    return CUDA_SUCCESS;
  }
  return CUDA_ERROR_NOT_FOUND;
}
CUresult cuMemAlloc(CUdeviceptr* address, size_t bytes) {
  void* const memory = std::malloc(bytes);
  std::memset(memory, 0xcd, bytes);
  *address = reinterpret_cast<CUdeviceptr>(memory);
  ++state.allocated;
  return CUDA_SUCCESS;
}
CUresult cuMemFree(CUdeviceptr address) {
  std::free(reinterpret_cast<void*>(address));
  --state.allocated;
  return CUDA_SUCCESS;
}
CUresult cuMemHostAlloc(void** memory, size_t bytes, unsigned flags) {
  if (flags != 0) return CUDA_ERROR_INVALID_VALUE;
  *memory = std::malloc(bytes);
  ++state.allocated;
  return CUDA_SUCCESS;
}
CUresult cuMemFreeHost(void* memory) {
  std::free(memory);
  --state.allocated;
  return CUDA_SUCCESS;
}
CUresult cuMemcpyHtoDAsync(CUdeviceptr to, const void* from, size_t bytes, CUstream stream) {
  std::memcpy(reinterpret_cast<void*>(to), from, bytes);
  return stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuMemcpyDtoHAsync(void* to, CUdeviceptr from, size_t bytes, CUstream stream) {
  std::memcpy(to, reinterpret_cast<const void*>(from), bytes);
  return stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuMemcpyDtoDAsync(CUdeviceptr to, CUdeviceptr from, size_t bytes, CUstream stream) {
  std::memcpy(reinterpret_cast<void*>(to), reinterpret_cast<const void*>(from), bytes);
  return stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuMemsetD8Async(CUdeviceptr to, unsigned char value, size_t bytes, CUstream stream) {
  std::memset(reinterpret_cast<void*>(to), value, bytes);
  return stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuStreamCreate(CUstream* stream, unsigned flags) {
  if (flags != CU_STREAM_NON_BLOCKING) return CUDA_ERROR_INVALID_VALUE;
  ++state.streams;
  *stream = handle<CUstream>(3 + state.streams);
  return CUDA_SUCCESS;
}
CUresult cuStreamDestroy(CUstream) {
  --state.streams;
  return CUDA_SUCCESS;
}
CUresult cuStreamSynchronize(CUstream stream) { return stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE; }
CUresult cuStreamWaitEvent(CUstream stream, CUevent event, unsigned flags) {
  return stream && event && flags == 0 ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuEventCreate(CUevent* event, unsigned flags) {
  if (flags != CU_EVENT_DISABLE_TIMING) return CUDA_ERROR_INVALID_VALUE;
  ++state.events;
  *event = handle<CUevent>(8 + state.events);
  return CUDA_SUCCESS;
}
CUresult cuEventRecord(CUevent event, CUstream stream) {
  return event && stream ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}
CUresult cuEventDestroy(CUevent) {
  --state.events;
  return CUDA_SUCCESS;
}
CUresult cuLaunchKernel(CUfunction function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x,
                        unsigned block_y, unsigned block_z, unsigned shared_bytes, CUstream stream, void** parameters,
                        void** extra) {
  const bool right = grid_x > 0 && grid_y == 1 && grid_z == 1 && block_x == 32 && block_y == 1 && block_z == 1 &&
                     shared_bytes == 0 && stream && !parameters && extra[0] == CU_LAUNCH_PARAM_BUFFER_POINTER &&
                     extra[2] == CU_LAUNCH_PARAM_BUFFER_SIZE && extra[4] == CU_LAUNCH_PARAM_END;
  if (!right) return CUDA_ERROR_INVALID_VALUE;
  // Only so many bytes are the kernel's.
  const size_t bytes = *static_cast<const size_t*>(extra[3]);
  void* const copy = std::malloc(bytes);
  std::memcpy(copy, extra[1], bytes);
  state.run(int(reinterpret_cast<size_t>(function) - 16), grid_x, copy);
  std::free(copy);
  return CUDA_SUCCESS;
}

}  // extern "C"
