// Traces all camera samples of a tile's pixels with one worker, batch by batch. Thread-safety: that of the worker.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "hybrid/path/tiles.h"
#include "hybrid/transport/transport.h"

namespace fieldtrace {

// Camera samples in one batch: enough for full packets and queues, few enough for the second-level cache.
inline constexpr int k_batch_samples = 4096;
inline constexpr int k_fewest_batch_samples = 16;

// The most camera samples in one batch. Batches hold whole pixels, whose shading points form clusters, or samples of
// one pixel alone; where workers fit blocks of pixels (tile_pixels() by blocks), whole blocks or parts of one.
inline int batch_samples(int lobe_samples) { return std::max(k_batch_samples / lobe_samples, k_fewest_batch_samples); }

// Samples of pixels[pixel], which fill [begin, begin + count) of a batch.
struct PixelRun {
  size_t pixel = 0, begin = 0;
  uint32_t count = 0;
};

// Traces counts[i] camera samples of pixels[i], those of the sequences of number `replicate` from the first on. Calls
// add(i, radiance, firsts) for runs of samples of pixels[i], in the order of pixels and sample indices whatever the
// batches; `firsts` holds the camera samples' first hits, empty unless the worker's settings keep them. lobe_samples:
// as in these settings; each camera sample may split into this many rays. Before each batch goes_on() is called; if it
// returns false, the rest is skipped and false returned.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, std::span<const uint32_t> counts, uint32_t replicate,
                  int lobe_samples, TransportWorker& worker, const GoesOn& goes_on, const Add& add) {
  const size_t most = size_t(batch_samples(lobe_samples));
  CameraSamples samples;
  samples.replicate = replicate;
  std::vector<Rgb> radiance;
  std::vector<PixelRun> runs;
  const bool by_blocks = worker.fits_blocks();
  size_t pixel = 0;
  uint32_t done = 0;  // samples of that pixel
  while (true) {
    samples.resize(most);
    runs.clear();
    size_t size = 0;
    samples.whole_blocks = true;
    while (pixel < pixels.size()) {
      // Whole blocks, or pixels, unless one alone does not fit.
      const auto is_one = [&](size_t a, size_t b) { return by_blocks && in_one_block(pixels[a], pixels[b]); };
      size_t block_end = pixel + 1, block_size = counts[pixel];
      for (; block_end < pixels.size() && is_one(pixel, block_end); ++block_end) block_size += counts[block_end];
      const bool begins = done == 0 && (pixel == 0 || !is_one(pixel - 1, pixel));
      const bool is_whole = begins && block_size <= most;
      if (size > 0 && samples.whole_blocks && (!is_whole || size + block_size > most)) break;
      if (!is_whole) samples.whole_blocks = false;
      while (pixel < block_end) {
        const size_t left = counts[pixel] - done;
        if (size > 0 && size + left > most) break;
        const auto count = uint32_t(std::min(left, most));
        const PixelPosition& p = pixels[pixel];
        for (uint32_t i = 0; i < count; ++i) samples.set(size + i, uint32_t(p.x), uint32_t(p.y), done + i);
        if (count > 0) runs.push_back({pixel, size, count});
        size += count;
        done += count;
        if (done < counts[pixel]) break;
        ++pixel, done = 0;
      }
      if (pixel < block_end) break;
    }
    if (size == 0) return true;
    if (!goes_on()) return false;
    samples.resize(size);
    radiance.resize(size);
    worker.trace(samples, radiance);
    const std::span<const FirstHit> firsts = worker.first_hits();
    for (const PixelRun& run : runs) {
      add(run.pixel, std::span<const Rgb>(radiance).subspan(run.begin, run.count),
          firsts.empty() ? firsts : firsts.subspan(run.begin, run.count));
    }
  }
}

// The same with `spp` samples of every pixel.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, int spp, int lobe_samples, TransportWorker& worker,
                  const GoesOn& goes_on, const Add& add) {
  const std::vector<uint32_t> counts(pixels.size(), uint32_t(spp));
  return trace_pixels(pixels, counts, 0, lobe_samples, worker, goes_on, add);
}

}  // namespace fieldtrace
