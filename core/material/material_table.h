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

  // The result of resolve_material() for Scene::bsdfs[bsdf]; null if it varies over the surface, or if cos_wi is 0 or
  // NaN.
  const Material* find(uint32_t bsdf, float cos_wi) const {
    if (!(cos_wi < 0.0f || cos_wi > 0.0f) || textured_[bsdf]) return nullptr;
    return &sides_[2 * bsdf + (cos_wi < 0.0f ? 1 : 0)];
  }

 private:
  std::vector<Material> sides_;  // front and back of each Bsdf
  std::vector<bool> textured_;
};

}  // namespace fieldtrace
