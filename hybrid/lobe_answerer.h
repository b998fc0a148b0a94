// Answers glossy rays by pictures of radiance: what they meet on objects that have such pictures, and how much of them
// passes by. The rest is for exact rays: other objects, and what the pictures do not resolve.
//
// A glossy sample stands for a part of its lobe. The pictures give that part's mean radiance on each object, front to
// back, with the share that each leaves to those behind it; the ray goes on with what is left, among the objects
// without pictures. So a sample is filtered, and neither shading nor shadow rays are needed where it ends. Which
// objects have pictures follows from the scene and constants; a ray's answer depends on the ray, the scene and the
// settings. Thread-safety: const functions may be called from any number of threads; pictures grow by demand meanwhile.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/accel.h"
#include "field/segment_kernels.h"
#include "hybrid/radiance_pictures.h"
#include "hybrid/stats.h"

namespace fieldtrace {

// What a wave of bounce rays is to be answered into, by ray.
struct LobeResults {
  HitBatch& hits;              // where the rest of the ray ends
  std::vector<Rgb>& arriving;  // radiance found on the way
  std::vector<float>& clear;   // share of the ray that goes on to the hit
};

// Of a glossy ray: what it needs to know of the surface that it left.
struct LobeRay {
  Vec3 normal = Vec3(0.0f, 0.0f, 1.0f);  // geometric, on the ray's side
  uint32_t instance = k_none;
  float density = 0.0f;  // samples x solid-angle density of the direction; 0: not glossy, an exact ray
  float alpha = 0.0f;    // roughness of the lobe
};

class LobeAnswerer {
 public:
  // With more objects than this that could have pictures none has: their tests would cost more than a ray.
  static constexpr size_t k_most_objects = 16;

  // The objects' radiance is shaded by the lights of `shading`, which must outlive this. `most_rays`: glossy rays that
  // the picture will send at most; objects that could take more light samples are left out, and those whose pictures
  // could outgrow `most_bytes` together with those before them.
  LobeAnswerer(const TransportContext& shading, float tolerance, uint64_t most_rays, uint64_t most_bytes);
  ~LobeAnswerer();

  bool empty() const { return pictures_.empty(); }
  uint64_t bytes() const;

  // rays[i] belongs to lobes[i]; rays are unit and endless. Results are resized by this.
  void answer(const RayBatch& rays, std::span<const LobeRay> lobes, LobeResults& results, Stats& stats) const;

 private:
  struct Workspace;
  void ask(RadiancePictures& pictures, const LobeBatch& lobes, LobeAnswers& answers, ConeUnknowns& unknowns,
           Stats& stats) const;

  const TransportContext& shading_;
  const SegmentKernels& kernels_;
  float blur_;  // tangent that half a texel may take, for each unit of alpha
  std::vector<std::unique_ptr<RadiancePictures>> pictures_;
  std::shared_ptr<const Accel::Group> others_;  // instances without pictures
  bool has_others_ = false;
};

}  // namespace fieldtrace
