// Ambient occlusion at the camera samples' first hits: the share of cosine-distributed rays that meet nothing nearby.
//
// Source: S. Zhukov, A. Iones, G. Kronin, "An Ambient Light Illumination Model", EGWR 1998, with the cosine of H.
// Landis, "Production-Ready Global Illumination", SIGGRAPH 2002 course notes, and a hard cut-off distance. It is the
// light of a white sky: direction maps answer for it once per pixel (sky_light.h) where there are any. Else it takes
// exact rays to samples of a constant light (the same low-discrepancy points as lights, in a separate stream), cut off
// at the distance. Thread-safety: an AmbientOcclusion belongs to one thread.
#pragma once

#include <span>

#include "hybrid/light/sky_light.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"

namespace fieldtrace {

// A scene of nothing but a constant emitter of radiance 1.
Scene white_sky();

class AmbientOcclusion {
 public:
  explicit AmbientOcclusion(const TransportContext& context);

  // Forgets the points added so far and makes room for `most`, if the settings want occlusion.
  void clear(size_t most);
  // Adds the first hit of the camera sample `slot` of the batch, whose index in its pixel is `index`; `pixel`: as in
  // LightReceivers. Works for any material: the rays leave on the side of the geometric normal that the camera sees.
  void add(const PathVertex& vertex, uint32_t slot, uint32_t pixel, uint32_t index);
  // What gather() is given; `pixels`: as DirectLight::Request.
  struct Request {
    AmbientOcclusion& occlusion;
    std::span<const PixelPosition> pixels;
    std::span<FirstHit> firsts;
    Stats& stats;
  };
  // Adds the counts of all points to firsts[slot]; its time and rays count as those of shadow rays.
  static void gather(const Request& request);
  // The same for several requests of one context, in parallel, whose cells are asked of the context's device in waves;
  // there must be one.
  static void gather_waves(std::span<const Request> requests);

 private:
  // By maps: what the sky is asked for, and what it answered.
  SkyLight::Request sky_request(const Request& request);
  void take_irradiance(const Request& request);
  void gather_by_rays(std::span<FirstHit> firsts, Stats& stats);
  // Where the rays of the points in shading_points_ can end.
  LightExtent reach() const;
  void count(size_t begin, std::span<FirstHit> firsts, Stats& stats) const;

  const TransportContext& context_;
  SkyLight by_maps_;
  LightReceivers receivers_;  // the points, of albedo 1
  struct {
    uint64_t all = 0, spared = 0, by_strata = 0;
  } before_;  // light samples of the statistics
  ShadingClusters clusters_;
  LightTable sky_;                    // one constant light; empty where the settings want no occlusion
  ShadingPointBatch shading_points_;  // some of them
  ShadowBatch rays_;
  ShadowGroup candidates_;
};

}  // namespace fieldtrace
