// The irradiance that surfaces have from direction cells of the sky that nothing hides.
//
// A cell's light weighs the mean cosine over the cell, which is right for cells across the horizon, too.
// Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_IRRADIANCE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_IRRADIANCE_HD_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_IRRADIANCE_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_IRRADIANCE_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_lights.h"

FT_LANES_BEGIN

// The mean of max(0, x) for x uniform in [mean - half, mean + half]: of the cosine over a cell across the horizon.
// Without a condition, so that compilers make vectors of loops over floats, too.
template <class F>
FT_HD_INLINE F cosine_over_cell(F mean, F half) {
  const F zero = splat<F>(0.0f);
  const F across = min(max(mean + half, zero), half + half);
  return across * across / (splat<F>(4.0f) * half) + max(mean - half, zero);
}

// How far the middle of a cell's light moves when the light is weighed by the cosine: the change of the cosine, for
// cosines uniform in [mean - half, mean + half] of which only those above 0 count.
template <class F>
FT_HD_INLINE F cosine_shift(F mean, F half) {
  const F zero = splat<F>(0.0f), third = splat<F>(1.0f / 3.0f);
  const F whole = half * half * third / max(mean, half);
  const F across = max(mean + half, zero) * (third + third) - mean;
  return select(mean >= half, whole, across);
}

// What light weighs that arrives at the cosine `c`, in [0, 1]: c times the transmittance of an interface
// (CellPoints::grazing).
template <class F>
FT_HD_INLINE F weight_of_cosine(F c, float grazing) {
  const F one = splat<F>(1.0f), x = max(one - c, splat<F>(0.0f)), x2 = x * x;
  return c * (one - splat<F>(grazing) * (x2 * x2 * x));
}

// Sets the irradiance on each normal, by a loop over all cells.
template <class F>
FT_HD_INLINE void sum_cells(const CellLights& cells, const CellNormals& normals, float grazing,
                            const CellLightSums& sums) {
  for (int32_t i = 0; i < normals.size; i += Lanes<F>::k_count) {
    const F x = load_lanes<F>(normals.x + i), y = load_lanes<F>(normals.y + i), z = load_lanes<F>(normals.z + i);
    F red = splat<F>(0.0f), green = red, blue = red;
    for (int32_t c = 0; c < cells.count; ++c) {
      const F mean = x * splat<F>(cells.vx[c]) + y * splat<F>(cells.vy[c]) + z * splat<F>(cells.vz[c]);
      F cosine = cosine_over_cell<F>(mean, splat<F>(cells.half_width[c]));
      if (grazing > 0.0f) cosine = weight_of_cosine<F>(cosine, grazing);
      const F received = cosine * splat<F>(cells.solid_angle[c]);
      red = red + received * splat<F>(cells.red[c]);
      green = green + received * splat<F>(cells.green[c]);
      blue = blue + received * splat<F>(cells.blue[c]);
    }
    store_lanes(red, sums.red + i), store_lanes(green, sums.green + i), store_lanes(blue, sums.blue + i);
  }
}

FT_LANES_END

#endif  // toggled guard
