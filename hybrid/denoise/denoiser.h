// What denoises: Intel Open Image Denoise, behind a plain function in a module (core/platform/module.h) that is built
// where the library was found (hybrid/oidn).
//
// Memory layout: images are width * height pixels of three floats each, row by row.
// Thread-safety: the function may be called from any thread.
#pragma once

#include <string>

namespace fieldtrace {

inline constexpr const char* k_denoiser_module = "oidn";
inline constexpr const char* k_denoiser_function = "fieldtrace_denoise";

struct DenoiserInput {
  int width = 0, height = 0;
  // Linear radiance, 0 or more; albedo, 0 to 1; unit normals, shorter where surfaces differ.
  float* colour = nullptr;
  float* albedo = nullptr;
  float* normal = nullptr;
  float* result = nullptr;
  int threads = 0;  // 0: all
  // Albedo and normal are filtered first, in place, so that their noise does not become the picture's.
  bool noisy_layers = false;
};

// Fills `result` and names the library and its version. Throws std::runtime_error with the library's reason.
using Denoiser = void(const DenoiserInput& input, std::string& name);

}  // namespace fieldtrace
