// The thesis' pipeline: primary hits, Phong lighting with shadows, recursive reflection, one ray per pixel.
//
// Source: A. Andreadis, 2008, algorithms 1 to 7. Rays are processed in batches, one tile and one depth at a time; a
// batch's reflected rays form the next one. Deterministic for any number of threads.
// Thread-safety: may run in several threads with different outputs.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/thesis/scene.h"
#include "tools/thesis/tracer.h"

namespace fieldtrace {

// Display values in [0, 1], row 0 at the top.
struct PhongPicture {
  int size = 0;  // width and height
  std::vector<Rgb> pixels;
};

struct PhongRenderOptions {
  int size = 512;
  // Rays per reflection: 1 for mirrors; 4 spread over a cone of scene.polish_radius, at every depth.
  int reflection_rays = 1;
};

PhongPicture render_phong(const PhongScene& scene, const PhongTracer& tracer, const PhongRenderOptions& options);

}  // namespace fieldtrace
