#include "core/surfaces.h"

#include "core/bsdf.h"
#include "core/surface_kernels.h"

namespace fieldtrace {

Surfaces::Surfaces(const Scene& scene, Isa isa)
    : scene_(scene), isa_(resolve_isa(isa)), group_size_(scene.instances.size(), 0) {
  for (uint32_t i = 0; i < scene.bsdfs.size(); ++i) textured_.push_back(is_textured(scene, i));
}

// A counting sort: fills met_ and places_, and group_size_ with the ends of the groups in places_.
void Surfaces::group_by_instance(size_t count, const HitBatch& hits) {
  met_.clear();
  uint32_t found = 0;
  for (size_t i = 0; i < count; ++i) {
    const uint32_t instance = hits.instance[i];
    if (instance == k_none) continue;
    ++found;
    if (group_size_[instance]++ == 0) met_.push_back(instance);
  }
  places_.resize(found);
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const uint32_t size = group_size_[instance];
    group_size_[instance] = begin;
    begin += size;
  }
  for (size_t i = 0; i < count; ++i) {
    if (hits.instance[i] != k_none) places_[group_size_[hits.instance[i]]++] = int32_t(i);
  }
}

void Surfaces::evaluate(const RayBatch& rays, const HitBatch& hits) {
  surfaces_.resize(rays.size);
  group_by_instance(rays.size, hits);
  const SurfaceKernel kernel = surface_kernel_for(isa_);
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const uint32_t end = group_size_[instance];
    const Instance& placed = scene_.instances[instance];
    const Shape& shape = scene_.shapes[placed.shape];
    if (is_meshed(shape.kind)) {
      kernel({scene_, instance, hits, places_.data() + begin, end - begin}, surfaces_.data());
      if (textured_[placed.bsdf]) {
        for (uint32_t k = begin; k < end; ++k) {
          const auto i = size_t(places_[k]);
          surfaces_[i].uv = triangle_uv(shape, hits.primitive[i], hits.u[i], hits.v[i]);
        }
      }
    } else {
      for (uint32_t k = begin; k < end; ++k) {
        surfaces_[size_t(places_[k])] = surface_at(scene_, rays, hits, size_t(places_[k]));
      }
    }
    group_size_[instance] = 0;
    begin = end;
  }
}

}  // namespace fieldtrace
