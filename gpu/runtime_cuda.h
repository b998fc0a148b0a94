// The run-time layer over CUDA's driver, opened when it is first asked for: nothing is linked, and no header of CUDA is
// needed. The types that stand for CUDA's are checked against its headers where a CUDA compiler is found
// (tests/gpu/cuda_runtime_test.cpp).
//
// Thread-safety: as gpu/runtime.h.
#pragma once

#include <memory>
#include <string>

#include "gpu/runtime.h"

namespace fieldtrace::gpu {

// CUdeviceptr, CUcontext, CUmodule, CUfunction, CUstream, CUevent, CUdevice, CUresult.
using DriverHandle = void*;

// The driver's functions, by their names without the prefix `cu`; null until they are loaded.
struct DriverFunctions {
  int (*Init)(unsigned flags) = nullptr;
  int (*GetErrorString)(int error, const char** text) = nullptr;
  int (*DeviceGetCount)(int* count) = nullptr;
  int (*DeviceGet)(int* device, int ordinal) = nullptr;
  int (*DeviceGetName)(char* name, int length, int device) = nullptr;
  int (*DeviceGetAttribute)(int* value, int attribute, int device) = nullptr;
  int (*DeviceTotalMem)(size_t* bytes, int device) = nullptr;
  int (*DevicePrimaryCtxRetain)(DriverHandle* context, int device) = nullptr;
  int (*DevicePrimaryCtxRelease)(int device) = nullptr;
  int (*CtxSetCurrent)(DriverHandle context) = nullptr;
  int (*ModuleLoadData)(DriverHandle* module, const void* image) = nullptr;
  int (*ModuleUnload)(DriverHandle module) = nullptr;
  int (*ModuleGetFunction)(DriverHandle* function, DriverHandle module, const char* name) = nullptr;
  int (*MemAlloc)(unsigned long long* address, size_t bytes) = nullptr;
  int (*MemFree)(unsigned long long address) = nullptr;
  int (*MemHostAlloc)(void** memory, size_t bytes, unsigned flags) = nullptr;
  int (*MemFreeHost)(void* memory) = nullptr;
  int (*MemcpyHtoDAsync)(unsigned long long to, const void* from, size_t bytes, DriverHandle stream) = nullptr;
  int (*MemcpyDtoHAsync)(void* to, unsigned long long from, size_t bytes, DriverHandle stream) = nullptr;
  int (*MemcpyDtoDAsync)(unsigned long long to, unsigned long long from, size_t bytes, DriverHandle stream) = nullptr;
  int (*MemsetD8Async)(unsigned long long to, unsigned char value, size_t bytes, DriverHandle stream) = nullptr;
  int (*StreamCreate)(DriverHandle* stream, unsigned flags) = nullptr;
  int (*StreamDestroy)(DriverHandle stream) = nullptr;
  int (*StreamSynchronize)(DriverHandle stream) = nullptr;
  int (*StreamWaitEvent)(DriverHandle stream, DriverHandle event, unsigned flags) = nullptr;
  int (*EventCreate)(DriverHandle* event, unsigned flags) = nullptr;
  int (*EventRecord)(DriverHandle event, DriverHandle stream) = nullptr;
  int (*EventDestroy)(DriverHandle event) = nullptr;
  int (*LaunchKernel)(DriverHandle function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x,
                      unsigned block_y, unsigned block_z, unsigned shared_bytes, DriverHandle stream, void** parameters,
                      void** extra) = nullptr;
};

// Opens the driver's library. Throws Error saying what is missing.
std::unique_ptr<Runtime> open_cuda_runtime(const std::string& library = "libcuda.so.1");

}  // namespace fieldtrace::gpu
