#include "core/material/material_table.h"

namespace fieldtrace {

MaterialTable::MaterialTable(const Scene& scene) {
  for (uint32_t i = 0; i < scene.bsdfs.size(); ++i) {
    const bool textured = is_textured(scene, i);
    textured_.push_back(textured);
    for (const float side : {1.0f, -1.0f}) {
      sides_.push_back(resolve_material(scene, i, Vec2(0.0f), side));
    }
    const Material* const sides = &sides_[2 * i];
    const bool is_masked = textured && scene.bsdfs[i].opacity != k_none;  // perhaps elsewhere on the surface
    diffuse_.push_back(!is_masked && sides[0].plain_diffuse() && sides[1].plain_diffuse());
  }
}

}  // namespace fieldtrace
