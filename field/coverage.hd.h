// Coverage of a patch of parallel lines: how many of them meet the object, and how deep, by summed-area tables.
//
// For each direction cell the plane through the centre perpendicular to the cell's direction c holds L x L parallel
// lines along c, one for each texel of [-1, 1]^2, and what a light sees that shines along -c: whether the line meets
// the object, and where first. Tiles of 32 x 32 texels are baked by demand. A tile is a summed-area table (Crow,
// "Summed-Area Tables for Texture Mapping", SIGGRAPH 1984) of 33 x 33 words, row y, column x: the sum over all texels
// of the tile below and left of corner (x, y), bits 0-10 the count of lines that hit, bits 11-30 the sum of their
// depths in steps of k_coverage_depth_step from depth -1 (depth: coordinate along c). Sums of a whole tile stay below
// 2^31, so the four corners of any rectangle combine by integer arithmetic on whole words. Table: tile_of[direction *
// tiles^2 + tile row * tiles + tile column] -> tile; 0: not baked; 1: baked, meets nothing. Thread-safety: pure
// functions over a CoverageView.

#if defined(FIELDTRACE_FIELD_COVERAGE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_COVERAGE_HD_H_
#undef FIELDTRACE_FIELD_COVERAGE_HD_H_
#else
#define FIELDTRACE_FIELD_COVERAGE_HD_H_
#endif

#include "core/lanes.hd.h"
#include "core/platform.h"
#include "field/view.h"

FT_LANES_BEGIN

constexpr int k_tile_lines = 32;
constexpr int k_tile_corners = k_tile_lines + 1;
constexpr int k_tile_words = 1104;  // 33 * 33, to whole cache lines
constexpr int k_coverage_depths = 1024;
constexpr float k_coverage_depth_step = 2.0f / float(k_coverage_depths - 1);
constexpr int k_count_bits = 11;

// Texels [x0, x1) x [y0, y1) of one direction cell's plane.
template <class F>
struct TexelRect {
  Int_t<F> x0, x1, y0, y1;
};

template <class F>
struct CoverageSum {
  Int_t<F> count, depths;  // lines that hit, and the sum of their depth codes
  Mask_t<F> unknown;       // some tile is not baked
};

// The part of [begin, end) in tile `number` of its axis, relative to the tile; empty: not (begin < end).
template <class F>
FT_HD_INLINE void clip_to_tile(Int_t<F> number, Int_t<F>& begin, Int_t<F>& end) {
  const Int_t<F> base = shift_left<5>(number);
  begin = max(begin - base, splat_int<F>(0));
  end = min(end - base, splat_int<F>(k_tile_lines));
}

// Sums over the rectangles of the wanted lanes; rectangles lie within [0, L]^2 (unchecked). tell_missing(slots, mask)
// is called with the slots of tiles that are not baked.
template <class F, class TellMissing>
FT_HD_INLINE CoverageSum<F> sum_coverage(const CoverageView& view, Int_t<F> direction, const TexelRect<F>& rect,
                                         Mask_t<F> wanted, const TellMissing& tell_missing) {
  const Int_t<F> zero = splat_int<F>(0), row = splat_int<F>(k_tile_corners);
  const Int_t<F> first_x = shift_right<5>(rect.x0), first_y = shift_right<5>(rect.y0);
  const Int_t<F> plane = direction * splat_int<F>(view.tiles * view.tiles);
  CoverageSum<F> sum = {zero, zero, and_not(wanted, wanted)};
  for (int j = 0; j < view.tiles; ++j) {
    const Int_t<F> tile_y = first_y + splat_int<F>(j);
    Int_t<F> y0 = rect.y0, y1 = rect.y1;
    clip_to_tile<F>(tile_y, y0, y1);
    const Mask_t<F> in_row = wanted & (y0 < y1);
    if (!any(in_row)) break;
    for (int i = 0; i < view.tiles; ++i) {
      const Int_t<F> tile_x = first_x + splat_int<F>(i);
      Int_t<F> x0 = rect.x0, x1 = rect.x1;
      clip_to_tile<F>(tile_x, x0, x1);
      const Mask_t<F> inside = in_row & (x0 < x1);
      if (!any(inside)) break;
      const Int_t<F> slot = select(inside, plane + tile_y * splat_int<F>(view.tiles) + tile_x, zero);
      const Int_t<F> tile = gather(view.tile_of, slot);
      order_loads();  // a baker publishes the number last
      const Mask_t<F> missing = inside & (tile < splat_int<F>(1));
      if (any(missing)) {
        sum.unknown = sum.unknown | missing;
        tell_missing(slot, missing);
      }
      const Mask_t<F> filled = inside & (tile > splat_int<F>(1));
      if (!any(filled)) continue;
      const Int_t<F> base = tile * splat_int<F>(k_tile_words);
      const Int_t<F> low = base + y0 * row, high = base + y1 * row;
      const auto corner = [&](Int_t<F> index) { return gather(view.sums, select(filled, index, zero)); };
      const Int_t<F> word = (corner(high + x1) - corner(high + x0)) - (corner(low + x1) - corner(low + x0));
      sum.count = sum.count + select(filled, word & splat_int<F>((1 << k_count_bits) - 1), zero);
      sum.depths = sum.depths + select(filled, shift_right<k_count_bits>(word), zero);
    }
  }
  return sum;
}

FT_LANES_END

#endif  // toggled guard
