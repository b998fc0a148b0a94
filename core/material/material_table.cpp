#include "core/material/material_table.h"

namespace fieldtrace {

MaterialTable::MaterialTable(const Scene& scene) {
  for (uint32_t i = 0; i < scene.bsdfs.size(); ++i) {
    const bool textured = is_textured(scene, i);
    textured_.push_back(textured);
    for (const float side : {1.0f, -1.0f}) {
      sides_.push_back(textured ? Material() : resolve_material(scene, i, Vec2(0.0f), side));
    }
  }
}

}  // namespace fieldtrace
