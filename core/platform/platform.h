// Compiler-dependent macros. The project's other macros (FT_*) are those of core/simd/lane_namespace.h and
// core/simd/isa_dispatch.h.
#pragma once

// FT_HD marks a function that is compiled for the host and, by a CUDA compiler, for the device too.
#if defined(__CUDACC__)
#define FT_HD __host__ __device__
#else
#define FT_HD
#endif

// FT_HD_INLINE marks lane code that must be inlined: a call would pass whole vectors through memory.
#if defined(__CUDACC__)
#define FT_HD_INLINE __host__ __device__ __forceinline__
#elif defined(__GNUC__)
#define FT_HD_INLINE inline __attribute__((always_inline))
#else
#define FT_HD_INLINE inline
#endif

// FT_THREAD_SANITIZER is defined in host code built with -fsanitize=thread.
#if defined(__CUDA_ARCH__)
#elif defined(__SANITIZE_THREAD__)
#define FT_THREAD_SANITIZER
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define FT_THREAD_SANITIZER
#endif
#endif
