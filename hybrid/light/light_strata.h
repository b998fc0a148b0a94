// The strata of a light: cells of a grid over its sample square, each of which is seen as a whole.
//
// Thread-safety: pure.
#pragma once

#include "core/light/light.hd.h"

namespace fieldtrace {

inline constexpr int k_strata = 16;

struct StrataGrid {
  int columns = 0, rows = 0;  // k_strata cells, or none
};

// The grid whose cells are about as wide as high, as the tubes that fields see them by. None for lights whose cells
// are no parts of what is seen of them (meshes, lights that are sampled on their far side, too), and for lights too
// long for such cells. Sheared lights are judged by their edges.
StrataGrid strata_grid(const Light& light);

}  // namespace fieldtrace
