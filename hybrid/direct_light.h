// Direct light at a wave of path vertices: samples every light, has the shadow rays answered, adds up what arrives.
//
// Batches of about k_shadow_batch rays stay in the second-level cache between the three steps.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "hybrid/aovs.h"
#include "hybrid/halves.h"
#include "hybrid/path_batch.h"
#include "hybrid/transport.h"

namespace fieldtrace {

inline constexpr int k_shadow_batch = 8192;

// A part of a batch with too many objects about it is halved if its receivers send this many rays each to a light, and
// the part more than that many: with fewer, searching costs more than is saved (docs/decisions/010-crowds.md).
inline constexpr int k_fewest_halving_samples = 16;
inline constexpr int k_smallest_part_rays = 512;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `firsts`, if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  // Sorts lit_[begin, end) into those that some object may shadow and those that nothing can.
  void split_receivers(std::span<const PathVertex> vertices, const LightExtent& light, size_t begin, size_t end);
  void fill_receivers(std::span<const PathVertex> vertices, std::span<const PathState> paths);
  // A part of lit_, [begin, end).
  struct Part {
    size_t begin = 0, end = 0;
  };
  // Lights one part by one light. Leaves it undone, and its halves in parts_, if halve() says so.
  void gather_part(const Part& part, uint32_t light, std::span<const PathVertex> vertices,
                   std::span<const PathState> paths, int light_samples, std::span<FirstHit> firsts,
                   std::span<Rgb> arriving, Stats& stats);
  // Where candidates_ are too many for the part and halves may have fewer: pushes the halves onto parts_, true.
  bool halve(std::span<const PathVertex> vertices, const Part& part, int light_samples);
  void accumulate(uint32_t light, std::span<const PathVertex> vertices, int light_samples, std::span<Rgb> arriving);
  void count(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
             std::span<FirstHit> firsts, Stats& stats);

  const TransportContext& context_;
  ReceiverBatch receivers_;
  ShadowBatch shadows_;
  std::vector<uint32_t> lit_;    // vertices that take light samples
  std::vector<uint32_t> group_;  // those of the current batch
  std::vector<uint32_t> shadowed_, free_;
  ReceiverBatch places_;  // positions, errors and instances only
  ShadowGroup candidates_;
  std::vector<Part> parts_;  // of the batch, not lit yet by the current light
  bool in_halves_ = false;   // the batch's part of lit_ is in the order of order_by_halves
  std::vector<PlacedIndex> placed_;
};

}  // namespace fieldtrace
