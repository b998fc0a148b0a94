// Diffuse light that the objects of a scene send on: radiance of surfels, prefiltered so that one read tells what comes
// back from a direction cell.
//
// Of an object, for each of D x D directions of its maps' space, what is seen along them; of a parallelogram, what each
// place of it sends. Shading is left to others (hybrid/indirect/indirect_bounces.h).
// Thread-safety: set_radiance() of different instances may run at once; const otherwise.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/trace/accel.h"
#include "field/maps/cell_task.h"
#include "field/maps/radiance_pyramids.h"
#include "hybrid/sky/sky_maps.h"
#include "hybrid/sky/surfels.h"

namespace fieldtrace {

// D of each object, and texels along a side of its pyramids.
inline constexpr int k_object_directions = 8, k_object_texels = 16;
// Of parallelograms' at most; faces of boxes have half as many.
inline constexpr int k_most_plane_texels = 64;

class IndirectLight {
 public:
  // Bytes and surfels, at most, of parallelograms and other objects.
  struct Cost {
    uint64_t bytes = 0, surfels = 0;
  };
  static Cost cost(size_t planes, size_t objects, int plane_texels);

  // Black. `maps` must outlive it. `sends`: by instance, 1 where its light is known; such instances must have maps or
  // be parallelograms (unchecked). seen: points that the camera sees (plane_windows()). plane_texels: of
  // parallelograms, along a side; a power of two, 4 to k_most_plane_texels. Throws std::bad_alloc.
  IndirectLight(const Scene& scene, const Accel& accel, const SkyMaps& maps, std::span<const ShapeTraits> traits,
                std::span<const uint8_t> sends, std::span<const Vec3> seen, int plane_texels);

  // By instance. What sends no light has no surfels.
  size_t size() const { return instances_.size(); }
  const Surfels& surfels(size_t instance) const { return *instances_[instance].surfels; }
  bool sends(size_t instance) const { return instances_[instance].pyramids != nullptr; }
  // Whether a ray may meet an instance that sends nothing by way of this.
  bool may_meet_others(const Vec3& origin, const Vec3& d) const;
  bool has_others() const { return !others_.empty(); }
  // One radiance for each point of surfels().
  void set_radiance(size_t instance, std::span<const Rgb> radiance);
  // To be called after radiances have changed.
  void finish();

  // What `o` sends back along a cell of the world direction `d`.
  MapRadiance map_radiance(const SkyOccluder& o, const Vec3& d, float cell_width) const;
  // Of a parallelogram (`face` 0) or of a face of a box (BoxFaces).
  const PlaneRadiance* plane_radiance(const SkyOccluder& o, int face) const {
    return sends(o.instance) ? &instances_[o.instance].planes[size_t(face)] : nullptr;
  }
  // What a ray from `origin` along the unit direction `d` meets at `position` of an instance.
  Rgb radiance(uint32_t instance, const Vec3& position, const Vec3& origin, const Vec3& d) const;
  // Mean over all surfels, luminance.
  float mean_luminance() const { return mean_luminance_; }
  uint64_t bytes() const;

 private:
  struct OfInstance {
    std::shared_ptr<const Surfels> surfels;
    std::unique_ptr<RadiancePyramids> pyramids;
    RadianceView view;
    std::vector<PlaneRadiance> planes;  // of a parallelogram, or of the faces of a box
    double luminance_sum = 0.0;
  };
  void add_box(const Accel& accel, uint32_t shape, const BoxFaces& faces, const SkyOccluder& o);
  void add_plane(const Scene& scene, const Accel& accel, const Parallelogram& plane, std::span<const Vec3> seen,
                 const SkyOccluder& o);
  MapRadiance lines_of(const SkyOccluder& o, int map) const;

  const SkyMaps& maps_;
  int plane_texels_;
  std::vector<Mat3> frames_;  // by direction
  std::vector<OfInstance> instances_;
  std::vector<Sphere> others_;  // balls of the instances that send nothing
  float mean_luminance_ = 0.0f;
};

}  // namespace fieldtrace
