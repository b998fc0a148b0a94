// Traces all camera samples of a tile's pixels with one worker, batch by batch. Thread-safety: that of the worker.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "hybrid/path/tiles.h"
#include "hybrid/render/transport.h"

namespace fieldtrace {

// Camera samples in one batch: enough for full packets and queues, few enough for the second-level cache.
inline constexpr int k_batch_samples = 4096;
inline constexpr int k_fewest_batch_samples = 16;

// The most camera samples in one batch. Batches hold whole pixels, whose shading points form clusters, or samples of
// one pixel alone.
inline int batch_samples(int lobe_samples) { return std::max(k_batch_samples / lobe_samples, k_fewest_batch_samples); }

// Calls add(i, radiance, firsts) for runs of samples of pixels[i], in the order of pixels and sample indices whatever
// the batches; `firsts` holds the camera samples' first hits, empty unless the worker's settings keep them.
// lobe_samples: as in these settings; each camera sample may split into this many rays. Before each batch goes_on() is
// called; if it returns false, the rest is skipped and false returned.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, int spp, int lobe_samples, TransportWorker& worker,
                  const GoesOn& goes_on, const Add& add) {
  const size_t total = pixels.size() * size_t(spp);
  const size_t most = size_t(batch_samples(lobe_samples)), of_pixel = size_t(spp);
  CameraSamples samples;
  std::vector<Rgb> radiance(std::min(most, total));
  for (size_t begin = 0, end = 0; begin < total; begin = end) {
    if (!goes_on()) return false;
    const size_t pixel_end = (begin / of_pixel + 1) * of_pixel;
    end = std::min(of_pixel <= most ? begin + most / of_pixel * of_pixel : std::min(begin + most, pixel_end), total);
    samples.resize(end - begin);
    // Calls with each pixel of the batch and its range [from, to) of the batch.
    const auto each_pixel = [&](const auto& call) {
      for (size_t i = begin; i < end;) {
        const size_t pixel = i / size_t(spp), next = std::min((pixel + 1) * size_t(spp), end);
        call(pixel, i - begin, next - begin);
        i = next;
      }
    };
    each_pixel([&](size_t pixel, size_t from, size_t to) {
      const PixelPosition& p = pixels[pixel];
      const size_t first_index = begin + from - pixel * size_t(spp);
      for (size_t i = from; i < to; ++i) samples.set(i, uint32_t(p.x), uint32_t(p.y), uint32_t(first_index + i - from));
    });
    worker.trace(samples, {radiance.data(), samples.size});
    const std::span<const FirstHit> firsts = worker.first_hits();
    each_pixel([&](size_t pixel, size_t from, size_t to) {
      add(pixel, std::span(radiance).subspan(from, to - from),
          firsts.empty() ? firsts : firsts.subspan(from, to - from));
    });
  }
  return true;
}

}  // namespace fieldtrace
