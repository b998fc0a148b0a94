// Traces all camera samples of a tile's pixels with one worker, batch by batch. Thread-safety: that of the worker.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "hybrid/tiles.h"
#include "hybrid/transport.h"

namespace fieldtrace {

// Camera samples in one batch: enough for full packets and queues, few enough for the second-level cache.
inline constexpr int k_batch_samples = 4096;
inline constexpr int k_fewest_batch_samples = 16;

// Calls add(i, radiance, first) for every sample of pixels[i], in the order of pixels and of sample indices whatever
// the batches; `first` points to what the camera ray met, null unless the worker's settings ask for that.
// lobe_samples: as in these settings; each camera sample becomes so many rays. goes_on() is asked before each batch:
// where it says no, the rest is left, and false is returned.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, int spp, int lobe_samples, TransportWorker& worker,
                  const GoesOn& goes_on, const Add& add) {
  const size_t total = pixels.size() * size_t(spp);
  const size_t batch = size_t(std::max(k_batch_samples / lobe_samples, k_fewest_batch_samples));
  CameraSamples samples;
  std::vector<Rgb> radiance(std::min(batch, total));
  for (size_t begin = 0; begin < total; begin += batch) {
    if (!goes_on()) return false;
    const size_t end = std::min(begin + batch, total);
    samples.resize(end - begin);
    size_t pixel = begin / size_t(spp), index = begin % size_t(spp);
    const auto step = [&] {
      if (++index == size_t(spp)) index = 0, ++pixel;
    };
    for (size_t i = 0; i < samples.size; ++i, step()) {
      samples.set(i, uint32_t(pixels[pixel].x), uint32_t(pixels[pixel].y), uint32_t(index));
    }
    worker.trace(samples, {radiance.data(), samples.size});
    const std::span<const FirstHit> firsts = worker.first_hits();
    pixel = begin / size_t(spp), index = begin % size_t(spp);
    for (size_t i = 0; i < samples.size; ++i, step()) {
      add(pixel, radiance[i], firsts.empty() ? nullptr : &firsts[i]);
    }
  }
  return true;
}

}  // namespace fieldtrace
