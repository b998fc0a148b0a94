// Compiler-dependent macros. The project's other macros (FT_*) are those of core/simd/lane_namespace.h,
// core/simd/isa_dispatch.h and, for the device's compiler, gpu/device_code.h.
#pragma once

// FT_HD marks a function that is compiled for the host and, by a device's compiler, for the device too. Such a compiler
// has defined it, FT_HD_INLINE and, while it compiles for the device, FT_DEVICE_PASS before it reads this file.
#if !defined(FT_HD)
#define FT_HD
#endif

// FT_HD_INLINE marks lane code that must be inlined: a call would pass whole vectors through memory.
#if defined(FT_HD_INLINE)
#elif defined(__GNUC__)
#define FT_HD_INLINE inline __attribute__((always_inline))
#else
#define FT_HD_INLINE inline
#endif

// FT_THREAD_SANITIZER is defined in host code built with -fsanitize=thread.
#if defined(FT_DEVICE_PASS)
#elif defined(__SANITIZE_THREAD__)
#define FT_THREAD_SANITIZER
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define FT_THREAD_SANITIZER
#endif
#endif
