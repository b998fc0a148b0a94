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
// one pixel alone; where workers trace blocks of pixels together (tile_pixels() by blocks), whole blocks or parts of
// one.
inline int batch_samples(int lobe_samples) { return std::max(k_batch_samples / lobe_samples, k_fewest_batch_samples); }

// The sequences that a pixel's samples are taken from, which are independent of each other.
struct Sequences {
  int count = 1;
  uint32_t first_replicate = 0;  // of the first one; the next has the next number
};

// Part of a sequence.
struct SampleRange {
  uint32_t first = 0, count = 0;

  uint32_t end() const { return first + count; }
};

// Samples of pixels[pixel] of one sequence, which fill [begin, begin + count) of a batch; `first` is the first one's
// place in the sequence.
struct PixelRun {
  size_t pixel = 0, begin = 0;
  uint32_t first = 0, count = 0;
  int sequence = 0;
};

// Cuts the camera samples ranges[i] of pixels[i] in each sequence into batches. Sequences of a pixel lie together: they
// are lit as one. lobe_samples: as in the worker's settings; each camera sample may split into this many rays.
// by_blocks: as for tile_pixels().
class PixelBatches {
 public:
  PixelBatches(std::span<const PixelPosition> pixels, std::span<const SampleRange> ranges, const Sequences& sequences,
               int lobe_samples, bool by_blocks)
      : pixels_(pixels),
        ranges_(ranges),
        sequences_(sequences),
        most_(size_t(batch_samples(lobe_samples))),
        by_blocks_(by_blocks) {}

  // The next batch, in the order of pixels and sample indices, and whose samples it holds. False: there is none.
  bool next(CameraSamples& samples, std::vector<PixelRun>& runs) {
    samples.resize(most_);
    runs.clear();
    size_t size = 0;
    samples.whole_blocks = true;
    while (pixel_ < pixels_.size()) {
      // Whole blocks, or pixels, unless one alone does not fit.
      size_t block_end = pixel_ + 1, block_size = samples_of(pixel_);
      for (; block_end < pixels_.size() && is_one(pixel_, block_end); ++block_end) block_size += samples_of(block_end);
      const bool begins = done_ == 0 && (pixel_ == 0 || !is_one(pixel_ - 1, pixel_));
      const bool is_whole = begins && block_size <= most_;
      // Whole blocks and parts of others do not share a batch: which do would depend on the tile.
      if (size > 0 && (samples.whole_blocks != is_whole || (is_whole && size + block_size > most_))) break;
      if (!is_whole) samples.whole_blocks = false;
      while (pixel_ < block_end && add(samples, runs, size)) {
      }
      if (pixel_ < block_end) break;
    }
    samples.resize(size);
    return size > 0;
  }

 private:
  size_t samples_of(size_t pixel) const { return size_t(ranges_[pixel].count) * size_t(sequences_.count); }
  bool is_one(size_t a, size_t b) const { return by_blocks_ && in_one_block(pixels_[a], pixels_[b]); }

  // Adds what is left of a pixel's samples, or as many as fit. Returns whether it is the pixel's last.
  bool add(CameraSamples& samples, std::vector<PixelRun>& runs, size_t& size) {
    const size_t left = samples_of(pixel_) - done_;
    if (size > 0 && size + left > most_) return false;
    const PixelPosition& p = pixels_[pixel_];
    const SampleRange& range = ranges_[pixel_];
    for (const size_t end = done_ + std::min(left, most_); done_ < end;) {
      const auto sequence = uint32_t(done_ / range.count), done_of_it = uint32_t(done_ % range.count);
      const auto count = uint32_t(std::min<size_t>(range.count - done_of_it, end - done_));
      const uint32_t first = range.first + done_of_it, replicate = sequences_.first_replicate + sequence;
      for (uint32_t i = 0; i < count; ++i) samples.set(size + i, uint32_t(p.x), uint32_t(p.y), first + i, replicate);
      runs.push_back({pixel_, size, first, count, int(sequence)});
      size += count, done_ += count;
    }
    if (done_ < samples_of(pixel_)) return false;
    ++pixel_, done_ = 0;
    return true;
  }

  const std::span<const PixelPosition> pixels_;
  const std::span<const SampleRange> ranges_;
  const Sequences sequences_;
  const size_t most_;
  const bool by_blocks_;
  size_t pixel_ = 0;
  size_t done_ = 0;  // samples of that pixel, sequence after sequence
};

// Calls add(run, radiance, firsts) for runs of samples of one pixel and sequence; `firsts` holds the camera samples'
// first hits, empty unless the worker's settings keep them.
template <class Add>
void add_runs(std::span<const PixelRun> runs, std::span<const Rgb> radiance, std::span<const FirstHit> firsts,
              const Add& add) {
  for (const PixelRun& run : runs) {
    add(run, radiance.subspan(run.begin, run.count), firsts.empty() ? firsts : firsts.subspan(run.begin, run.count));
  }
}

// Traces the batches of PixelBatches and calls add() of add_runs() for all. Before each batch goes_on() is called; if
// it returns false, the rest is skipped and false returned.
template <class GoesOn, class Add>
bool trace_pixels(std::span<const PixelPosition> pixels, std::span<const SampleRange> ranges,
                  const Sequences& sequences, int lobe_samples, TransportWorker& worker, const GoesOn& goes_on,
                  const Add& add) {
  PixelBatches batches(pixels, ranges, sequences, lobe_samples, worker.traces_blocks());
  CameraSamples samples;
  std::vector<Rgb> radiance;
  std::vector<PixelRun> runs;
  while (batches.next(samples, runs)) {
    if (!goes_on()) return false;
    radiance.resize(samples.size);
    worker.trace(samples, radiance);
    add_runs(runs, radiance, worker.first_hits(), add);
  }
  return true;
}

}  // namespace fieldtrace
