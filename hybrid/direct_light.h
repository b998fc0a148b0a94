// Direct light at a wave of path vertices: samples every light, has the shadow rays answered, adds up what arrives.
//
// Batches of about k_shadow_batch rays stay in the second-level cache between the three steps.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "hybrid/aovs.h"
#include "hybrid/path_batch.h"
#include "hybrid/transport.h"

namespace fieldtrace {

inline constexpr int k_shadow_batch = 8192;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `firsts`, if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  void gather_from(uint32_t light, size_t begin, size_t end, std::span<const PathVertex> vertices,
                   std::span<const PathState> paths, int light_samples, std::span<FirstHit> firsts,
                   std::span<Rgb> arriving, Stats& stats);
  void gather_free(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                   int light_samples, std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);
  // Sorts lit_[begin, end) into those that some object may shadow, those that nothing can, and those that see nothing
  // of the light.
  void split_receivers(std::span<const PathVertex> vertices, const LightExtent& light, int light_samples, size_t begin,
                       size_t end, Stats& stats);
  void check_split(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                   int light_samples, Stats& stats);
  // Moves those of shadowed_ whose first samples agree to free_ or dark_.
  void sort_by_first_samples(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                             int light_samples, int first_samples, Stats& stats);
  // Shadow rays of group_.
  void sample(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
              int light_samples);
  void fill_receivers(std::span<const PathVertex> vertices, std::span<const PathState> paths);
  void accumulate(uint32_t light, std::span<const PathVertex> vertices, int light_samples, std::span<Rgb> arriving);
  void count(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
             std::span<FirstHit> firsts, Stats& stats);

  const TransportContext& context_;
  ReceiverBatch receivers_;
  ShadowBatch shadows_;
  std::vector<uint32_t> lit_;    // vertices that take light samples
  std::vector<uint32_t> group_;  // those of the current batch
  std::vector<uint32_t> shadowed_, free_, dark_;
  ReceiverBatch places_;  // without what light sampling needs
  ShadowGroup candidates_;
};

}  // namespace fieldtrace
