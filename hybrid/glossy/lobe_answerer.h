// Answers glossy rays by prefiltered radiance maps: the radiance that objects with such maps send along a ray, and the
// share of the ray that passes them. Exact rays find the rest: other objects, and what the maps do not resolve.
//
// A glossy sample stands for a part of its lobe. The maps give that part's mean radiance on each object and the share
// that passes it, composited front to back; the remaining share goes on among the objects without maps. So a sample is
// filtered, and neither shading nor shadow rays are needed where it ends. Which objects have maps follows from the
// scene, constants and the maps' memory budget; a ray's answer from the ray, the scene and the settings. Thread-safety:
// const functions may be called from any number of threads, each with its own workspace; maps grow on demand meanwhile.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/direction_order.h"
#include "hybrid/visibility/shape_traits.h"
#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace {

class RadianceMaps;
struct TransportContext;

// What the maps answer for one ray of a wave.
struct FilteredRay {
  uint32_t ray = 0;          // its index
  Rgb radiance = Rgb(0.0f);  // arriving along it from objects with maps
  float clear = 1.0f;        // share of the ray that goes on to its hit
  // The object behind which clear < 0.5, or the first that hides some of the ray; k_none: nothing hides it.
  uint32_t instance = k_none;
  float distance = 0.0f;
};

// A thread's scratch memory and the results of answer().
struct LobeWorkspace {
  std::vector<FilteredRay> filtered;

  // For all rays of the wave: samples x density (0: not glossy), and whether they may meet an object with maps.
  AlignedVector<float> density;
  AlignedVector<int32_t> met;
  std::vector<uint32_t> queried, exact;
  DirectionOrder order;
  LobeBatch batch;                      // of `queried`
  std::vector<LobeQuestion> questions;  // by object; empty: no device is asked
  std::vector<LobeAnswers> answers;     // by object
  ConeUnknowns unknowns;
  RaySubset some;
  HitWorkspace hits;
};

class LobeAnswerer {
 public:
  // Pictures of fewer glossy rays do not repay maps (docs/decisions/015-glossy.md).
  static constexpr uint64_t k_fewest_rays = uint64_t(1) << 25;

  // The instances that may have maps: none where there are more than k_most_candidates.
  static std::vector<uint32_t> suited_instances(const Scene& scene, std::span<const ShapeTraits> traits);

  struct Settings {
    float tolerance = 0.0f;
    uint64_t most_rays = 0;   // upper bound on the glossy rays of the picture: objects whose shading could take more
                              // have no maps
    uint64_t most_bytes = 0;  // nor have those whose maps could exceed this together with those before them
    bool check = false;       // compare some of the maps' answers with rays
  };
  // Maps of `suited`, shaded by paths of `shading` (SurfaceRadiance), which must outlive this. `hits`, if not null,
  // answers the rays that the maps refuse, and must outlive this.
  LobeAnswerer(const TransportContext& shading, std::span<const uint32_t> suited, const Settings& settings,
               const HitAnswerer* hits = nullptr);
  ~LobeAnswerer();

  bool empty() const { return maps_.empty(); }
  size_t left_out_for_memory() const { return left_out_for_memory_; }  // objects that most_bytes alone denies maps
  uint64_t bytes() const;

  // hits (resized by this) receives where each ray ends; for glossy paths, where the share that work.filtered leaves of
  // them does. work.hits.certified lists the hits that are known only within an error bound. rays[i] belongs to
  // paths[i]; rays are unit and infinite.
  struct Request {
    const RayBatch& rays;
    std::span<const PathState> paths;
    HitBatch& hits;
    LobeWorkspace& work;
    Stats& stats;
  };
  void answer(const Request& request) const;
  // The same for several requests, in parallel, whose maps `device` is asked about as one wave, and again about what
  // had to be baked; the CPU's kernels answer what it leaves. Its time counts as secondary.
  void answer(std::span<const Request> requests, VisibilityDevice& device) const;

 private:
  // Finds what is to be looked up, and traces what is not.
  void begin(const Request& request) const;
  void finish(const Request& request) const;
  void find_queried(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work) const;
  void trace_others(const RayBatch& rays, HitBatch& hits, LobeWorkspace& work) const;
  void fill_batch(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work) const;
  void ask(LobeWorkspace& work) const;
  void query(LobeWorkspace& work, Stats& stats) const;
  void put_together(const HitBatch& hits, LobeWorkspace& work) const;
  void trace_exact(const Request& request) const;
  void check_filtered(const Request& request) const;  // lobe_answerer_checks.cpp
  RadianceMaps* maps_of(uint32_t instance) const;     // null: it has none

  const TransportContext& shading_;
  const SegmentKernels& kernels_;
  const HitAnswerer* hits_;
  float blur_;  // tangent that half a texel may subtend, per unit of alpha
  bool check_;
  std::vector<std::unique_ptr<RadianceMaps>> maps_;
  size_t left_out_for_memory_ = 0;
  std::shared_ptr<const Accel::Group> others_;  // instances without maps; null: there are none
};

}  // namespace fieldtrace
