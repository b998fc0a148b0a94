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

// Calls add(i, result) for every sample of pixels[i], in the order of pixels and of sample indices whatever the
// batches. lobe_samples: as in the worker's settings; each camera sample becomes so many rays. goes_on() is asked
// before each batch: where it says no, the rest is left, and false is returned.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, int spp, int lobe_samples, TransportWorker& worker,
                  const GoesOn& goes_on, const Add& add) {
  const size_t total = pixels.size() * size_t(spp);
  const size_t batch = size_t(std::max(k_batch_samples / lobe_samples, k_fewest_batch_samples));
  std::vector<CameraSample> samples;
  std::vector<SampleResult> results(std::min(batch, total));
  for (size_t begin = 0; begin < total; begin += batch) {
    if (!goes_on()) return false;
    const size_t end = std::min(begin + batch, total);
    samples.clear();
    for (size_t i = begin; i < end; ++i) {
      const PixelPosition& p = pixels[i / size_t(spp)];
      samples.push_back({uint32_t(p.x), uint32_t(p.y), uint32_t(i % size_t(spp))});
    }
    worker.trace(samples, {results.data(), samples.size()});
    for (size_t i = begin; i < end; ++i) add(i / size_t(spp), results[i - begin]);
  }
  return true;
}

}  // namespace fieldtrace
