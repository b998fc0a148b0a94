// Direct light at a wave of path vertices, in four levels; each settles what it can and leaves the rest to the next.
//
// 1. The vertices of a pixel, or of a block of pixels, form clusters (shading_clusters.h). Instances that may stand
//    between a cluster and a light are found once; none: the light is seen whole.
// 2. Fields answer whole lights per cluster: clear, hidden, or open.
// 3. Open clusters: strata of the light, each filtered from coverage maps: a visible share, or undecided. Where many
//    are undecided, all are.
// 4. Light samples in undecided strata, and those of clusters that no field answers, become shadow rays.
// Monte Carlo has levels 1 and 4 alone, and closed forms per shading point. Diffuse surfaces reflect what is settled as
// one irradiance per cluster where the whole light is above their horizon; everything else weighs each light sample by
// itself.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "hybrid/light/group_light.h"
#include "hybrid/light/sky_light.h"

namespace fieldtrace {

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context), sky_(context, context.sky) {}

  // What gather() is given: one worker's wave of receivers.
  struct Request {
    DirectLight& direct;
    LightReceivers& receivers;
    std::span<const PathVertex> vertices;
    int light_samples = 1;
    bool first = false;                     // they are those of camera rays, pixel by pixel
    bool joins_pixels = false;              // numbers of clusters are those of blocks of pixels
    std::span<const PixelPosition> pixels;  // by path, if blocks of pixels are whole (pixel_blocks.h), else empty
    std::span<FirstHit> firsts;             // if not empty, indexed by path: receives the counts of shadow rays
    Stats& stats;
  };
  // Sorts the receivers as ShadingClusters does, and fills what arrives at them, group by group.
  static void gather(const Request& request);
  // The same for several requests of one context, which go from level to level together, in parallel, so that their
  // questions are waves of the context's device, which there must be.
  static void gather_waves(std::span<const Request> requests);

 private:
  void prepare(const Request& request);
  GroupLight& group(size_t i);
  // The groups' first clusters, and the end of the last one's.
  void cut_into_groups();
  SkyLight::Request sky_request(const Request& request);
  void gather_by_groups();
  static void gather_light(std::span<const Request> requests, uint32_t light);

  const TransportContext& context_;
  SkyLight sky_;
  ShadingClusters clusters_;
  std::optional<GroupLight::Shared> shared_;
  std::vector<size_t> begins_;
  std::deque<GroupLight> groups_;  // one is enough where groups come one after another
};

}  // namespace fieldtrace
