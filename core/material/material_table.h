// The materials of a scene that are constant over a surface, resolved once.
// Thread-safety: const after construction.
#pragma once

#include <vector>

#include "core/material/bsdf.h"

namespace fieldtrace {

class MaterialTable {
 public:
  // `scene` must outlive the object.
  explicit MaterialTable(const Scene& scene);

  // Whether resolve_material() of Scene::bsdfs[bsdf] depends on texture coordinates.
  bool varies(uint32_t bsdf) const { return textured_[bsdf]; }

  // The results of resolve_material() for Scene::bsdfs[bsdf] in front (cos_wi > 0) and behind (cos_wi < 0); null if
  // they vary over the surface.
  const Material* sides(uint32_t bsdf) const { return textured_[bsdf] ? nullptr : &sides_[2 * bsdf]; }
  // The same where both are plain_diffuse(), even if their reflectances vary over the surface; those are then
  // unspecified.
  const Material* diffuse_sides(uint32_t bsdf) const { return diffuse_[bsdf] ? &sides_[2 * bsdf] : nullptr; }

 private:
  std::vector<Material> sides_;  // front and back of each Bsdf
  std::vector<bool> textured_, diffuse_;
};

}  // namespace fieldtrace
