// Light transport: paths from the camera through the scene, in wavefronts of a few thousand camera samples.
//
// Each surface samples every light (direct_light.h), then the path continues in a direction sampled from the material
// (Kajiya, "The Rendering Equation", SIGGRAPH 1986). Emission that both strategies can find is weighted by the power
// heuristic with sample counts (Veach and Guibas, "Optimally Combining Sampling Techniques", SIGGRAPH 1995), except
// that on diffuse surfaces light samples alone count for lights sampled in closed form. Russian roulette as in
// Mitsuba's `path`. A path that turns below the *geometric* surface of something opaque ends there, as light samples
// do. Determinism: a camera sample's result depends on the scene, the settings, its pixel and its index only.
// Thread-safety: each thread has its own TransportWorker.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/camera/camera_samples.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/stats/stats.h"

namespace fieldtrace {

// Traces paths from the camera, and (PathFollower) from surfaces.
class TransportWorker final : public PathFollower {
 public:
  explicit TransportWorker(const TransportContext& context);
  ~TransportWorker() override;
  TransportWorker(TransportWorker&&) noexcept;

  // radiance[i] receives the radiance that arrives at camera sample i. Any number of samples; about 4096 / lobe_samples
  // is best.
  void trace(const CameraSamples& samples, std::span<Rgb> radiance);

  // The same for a band of batches, with a worker each, of one context: they go from surface to surface together, in
  // parallel, and their light's visibility is asked of the context's device, which there must be, in waves.
  struct Batch {
    TransportWorker& worker;
    const CameraSamples& samples;
    std::span<Rgb> radiance;
  };
  static void trace(std::span<const Batch> band);

  // TransportContext::traces_blocks().
  bool traces_blocks() const;

  // Of the samples of the last trace(); empty unless the settings keep first hits.
  std::span<const FirstHit> first_hits() const;

  uint64_t follow(std::vector<PathVertex>& vertices, std::vector<PathState>& paths, std::span<Rgb> radiance) override;

  // Counters and this thread's times; time_primary and time_secondary are sums over calls.
  const Stats& stats() const;

  // What the last trace() cost for each camera sample: seconds of this thread; the sample itself and its rays.
  struct Cost {
    double seconds = 0.0, work = 0.0;
  };
  const Cost& sample_cost() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fieldtrace
