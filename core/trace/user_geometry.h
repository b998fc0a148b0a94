// Objects of ours within Embree scenes of other programs, as Embree's user geometry.
//
// Thread-safety: Embree calls an object's functions from any number of threads.
#pragma once

#include <cstdint>
#include <memory>

#include "core/math/math.h"
#include "core/trace/rays.h"

struct RTCDeviceTy;
struct RTCSceneTy;

namespace fieldtrace {

// One geometry of one primitive. Rays are in the space of the scene that it is attached to, their directions of any
// length, and at most k_most_user_rays at once; those with tmax < 0 are none.
inline constexpr size_t k_most_user_rays = 16;

class UserGeometry {
 public:
  struct Hit {
    bool is_hit = false;
    float t = 0.0f, u = 0.0f, v = 0.0f;
    Vec3 normal = Vec3(0.0f);  // as Embree's Ng: need not be unit
    uint32_t primitive = 0;
  };

  virtual ~UserGeometry() = default;
  // None of these may throw.
  virtual Bounds3 bounds() const noexcept = 0;
  virtual void intersect(const RayBatch& rays, Hit* hits) const noexcept = 0;
  virtual void occluded(const RayBatch& rays, uint8_t* blocked) const noexcept = 0;
};

// A geometry attached to a scene, which both stay alive as long as this does. Its destruction detaches it; no thread
// may trace the scene meanwhile, nor until the scene was committed again.
class AttachedGeometry {
 public:
  // Throws Error if Embree refuses: a device that is not the scene's, or no memory.
  AttachedGeometry(RTCDeviceTy* device, RTCSceneTy* scene, std::unique_ptr<const UserGeometry> geometry);
  ~AttachedGeometry();
  AttachedGeometry(const AttachedGeometry&) = delete;
  AttachedGeometry& operator=(const AttachedGeometry&) = delete;

  uint32_t id() const { return id_; }

 private:
  RTCSceneTy* const scene_;
  const std::unique_ptr<const UserGeometry> geometry_;
  uint32_t id_ = 0;
};

}  // namespace fieldtrace
