// What far groups of objects leave of directions all over the cells of the sky (GroupLobe). Thread-safety: pure
// functions.

#if defined(FIELDTRACE_FIELD_MAPS_GROUP_LOBES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_GROUP_LOBES_HD_H_
#undef FIELDTRACE_FIELD_MAPS_GROUP_LOBES_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_GROUP_LOBES_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/group_lobe.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE F along_row(const float (&d)[3], const float* x, const float* y, const float* z) {
  return splat<F>(d[0]) * load_lanes<F>(x) + splat<F>(d[1]) * load_lanes<F>(y) + splat<F>(d[2]) * load_lanes<F>(z);
}

// Multiplies `clear`, one value a direction, by what the lobe leaves. `blocks`: room for all blocks' numbers and a
// vector more.
template <class F>
FT_HD_INLINE void hide_by_lobe(const GroupLobe& lobe, const PartDirections& parts, int32_t* blocks, float* clear) {
  constexpr int k_count = Lanes<F>::k_count;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), two = splat<F>(2.0f);
  int listed = 0;
  for (int32_t b = 0; b < parts.blocks; b += k_count) {
    const F cosine = along_row<F>(lobe.direction, parts.middle_x + b, parts.middle_y + b, parts.middle_z + b);
    const Mask_t<F> faces = cosine >= splat<F>(lobe.least_middle);
    if (any(faces)) listed += compress_store(lane_sequence<F>(b), faces, blocks + listed);
  }
  for (int k = 0; k < listed; ++k) {
    const int32_t begin = blocks[k] * k_part_block;
    for (int32_t i = begin; i < begin + k_part_block; i += k_count) {
      const float *x = parts.x + i, *y = parts.y + i, *z = parts.z + i;
      const F along = along_row<F>(lobe.direction, x, y, z);
      const F s = along_row<F>(lobe.x, x, y, z), t = along_row<F>(lobe.y, x, y, z);
      const F taken = min(max(two - two * (s * s + t * t), zero), one);
      const F left = select(along > zero, one - splat<F>(lobe.height) * taken, one);
      store_lanes(load_lanes<F>(clear + i) * left, clear + i);
    }
  }
}

FT_LANES_END

#endif  // toggled guard
