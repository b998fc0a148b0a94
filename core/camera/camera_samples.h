// Camera samples as structures of arrays, padded like RayBatch. Thread-safety: values.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/trace/rays.h"

namespace fieldtrace {

// The stream of sample points for camera rays (see vertex_seed in core/sampling/sobol.hd.h).
inline constexpr uint32_t k_camera_stream = 0x43414d00u;

// Camera samples: the pixel of the whole film that each belongs to, and its index in one of that pixel's sequences.
struct CameraSamples {
  size_t size = 0;
  bool whole_blocks = false;  // of each block of 8 x 8 pixels of the film they hold all that are sampled
  AlignedVector<uint32_t> x, y, index;
  AlignedVector<uint32_t> replicate;  // number of the sequence; those of different numbers are independent

  // Never shrinks the arrays; the entries below n are unspecified.
  void resize(size_t n) {
    size = n;
    for (auto* v : {&x, &y, &index, &replicate}) make_room(*v, padded(n));
  }
  void set(size_t i, uint32_t pixel_x, uint32_t pixel_y, uint32_t number, uint32_t sequence = 0) {
    x[i] = pixel_x, y[i] = pixel_y, index[i] = number, replicate[i] = sequence;
  }
};

// Of each sample, padded likewise (core/sampling/sobol.hd.h). The picture's seed is combined with the number of the
// sequence, unless that is 0.
struct SampleSeeds {
  AlignedVector<uint32_t> pixel;   // of the sequence: pixel_seed()
  AlignedVector<uint32_t> vertex;  // of the first hit: vertex_seed() of 0
};

}  // namespace fieldtrace
