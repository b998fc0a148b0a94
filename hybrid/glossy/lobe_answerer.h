// Answers glossy rays by prefiltered radiance maps: what they meet on objects that have such maps, and how much of them
// passes by. The rest is for exact rays: other objects, and what the maps do not resolve.
//
// A glossy sample stands for a part of its lobe. The maps give that part's mean radiance on each object, front to
// back, with the share that each leaves to those behind it; the ray goes on with what is left, among the objects
// without maps. So a sample is filtered, and neither shading nor shadow rays are needed where it ends. Which
// objects have maps follows from the scene, constants and the memory that they may take; a ray's answer depends on
// the ray, the scene and the settings. Thread-safety: const functions may be called from any number of threads, each
// with a workspace of its own; maps grow by demand meanwhile.
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

namespace fieldtrace {

class RadianceMaps;
struct TransportContext;

// What maps say of one ray of a wave.
struct FilteredRay {
  uint32_t ray = 0;          // its index
  Rgb radiance = Rgb(0.0f);  // that arrives along it from objects with maps
  float clear = 1.0f;        // share of it that goes on to its hit
  // The object behind which less than half of the ray goes on, if clear < 0.5.
  uint32_t instance = 0;
  float distance = 0.0f;
};

// What a thread works in, and what it was told.
struct LobeWorkspace {
  std::vector<FilteredRay> filtered;

  // Of all rays of the wave: samples x density (0: not glossy), and whether they may meet an object with maps.
  AlignedVector<float> density;
  AlignedVector<int32_t> met;
  std::vector<uint32_t> queried, exact;
  DirectionOrder order;
  LobeBatch batch;                   // asked
  std::vector<LobeAnswers> answers;  // by object
  ConeUnknowns unknowns;
  RaySubset some;
  HitWorkspace hits;
};

class LobeAnswerer {
 public:
  // With more objects than this that could have maps none has: their tests would cost more than a ray.
  static constexpr size_t k_most_objects = 16;

  // The instances that may have maps: none where there are more than k_most_objects.
  static std::vector<uint32_t> suited_instances(const Scene& scene, std::span<const ShapeTraits> traits);

  // Pictures of `suited`, shaded by paths of `shading` (SurfaceRadiance), which must outlive this. `most_rays`: glossy
  // rays that the picture will send at most; objects whose shading could take more are left out, and those whose
  // maps could outgrow `most_bytes` together with those before them. `hits`, if not null, is asked about the rays
  // that maps leave, and must outlive this.
  LobeAnswerer(const TransportContext& shading, std::span<const uint32_t> suited, float tolerance, uint64_t most_rays,
               uint64_t most_bytes, const HitAnswerer* hits = nullptr);
  ~LobeAnswerer();

  bool empty() const { return maps_.empty(); }
  uint64_t bytes() const;

  // hits (resized by this) receives where each ray ends, those of glossy paths beyond what work.filtered says of them;
  // work.hits.certified tells which hits are known within errors only.
  // rays[i] belongs to paths[i]; rays are unit and endless.
  void answer(const RayBatch& rays, std::span<const PathState> paths, HitBatch& hits, LobeWorkspace& work,
              Stats& stats) const;

 private:
  void find_queried(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work) const;
  void trace_others(const RayBatch& rays, HitBatch& hits, LobeWorkspace& work) const;
  void query(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work, Stats& stats) const;
  void put_together(const HitBatch& hits, LobeWorkspace& work) const;
  void trace_exact(const RayBatch& rays, std::span<const PathState> paths, HitBatch& hits, LobeWorkspace& work,
                   Stats& stats) const;

  const TransportContext& shading_;
  const SegmentKernels& kernels_;
  const HitAnswerer* hits_;
  float blur_;  // tangent that half a texel may take, for each unit of alpha
  std::vector<std::unique_ptr<RadianceMaps>> maps_;
  std::shared_ptr<const Accel::Group> others_;  // instances without maps; null: there are none
};

}  // namespace fieldtrace
