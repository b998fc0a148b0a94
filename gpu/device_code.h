// What the macros of core/platform/platform.h are to the CUDA compiler, which reads this file before any other
// (--pre-include, gpu/CMakeLists.txt), so that the shared headers need not know it.
#pragma once

#define FT_HD __host__ __device__
#define FT_HD_INLINE __host__ __device__ __forceinline__
// In the pass that compiles for the device alone.
#if defined(__CUDA_ARCH__)
#define FT_DEVICE_PASS
#endif
