// Coverage of a patch of parallel lines: how many of them meet the object, and how deep, by summed-area tables.
//
// For each direction cell, the plane through the centre perpendicular to the cell's direction c holds L x L parallel
// lines along c, one for each texel of [-1, 1]^2: the view of a light that shines along -c. Each line either misses the
// object or has the depth of its first hit (depth: coordinate along c). Tiles of 32 x 32 texels are baked on demand. A
// tile is a summed-area table (Crow, "Summed-Area Tables for Texture Mapping", SIGGRAPH 1984) of 33 x 33 words, row y,
// column x: the sum over all texels of the tile below and left of corner (x, y), bits 0-10 the count of lines that hit,
// bits 11-30 the sum of their depths in steps of k_coverage_depth_step from depth -1. Sums over a whole tile stay below
// 2^31, so the four corners of any rectangle combine by integer arithmetic on whole words. Where radiance is kept too,
// a tile has three more such tables of floats: sums, over the lines that hit, of the radiance that they meet. Table:
// tile_of[direction * tiles^2 + tile row * tiles + tile column] -> tile; 0: not baked; 1: baked, empty.
// Thread-safety: pure functions over a CoverageView.

#if defined(FIELDTRACE_FIELD_STORE_COVERAGE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_STORE_COVERAGE_HD_H_
#undef FIELDTRACE_FIELD_STORE_COVERAGE_HD_H_
#else
#define FIELDTRACE_FIELD_STORE_COVERAGE_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/store/view.h"

FT_LANES_BEGIN

constexpr int k_tile_lines = 32;
constexpr int k_tile_corners = k_tile_lines + 1;
constexpr int k_tile_words = 1104;  // 33 * 33 and the thin-feature ratio, padded to whole cache lines
constexpr int k_coverage_depths = 1024;
constexpr float k_coverage_depth_step = 2.0f / float(k_coverage_depths - 1);
constexpr int k_count_bits = 11;
// The word after a tile's sums: its thin-feature ratio in steps, the share of its outlines that belongs to features one
// texel wide (the number of texels that differ from both neighbours along an axis, over the number of neighbouring
// pairs that differ). Where it is large, the lines do not resolve the object.
constexpr int k_tile_thin_features = k_tile_corners * k_tile_corners;
constexpr float k_thin_feature_steps = 256.0f;

// Texels [x0, x1) x [y0, y1) of one direction cell's plane.
template <class F>
struct TexelRect {
  Int_t<F> x0, x1, y0, y1;
};

template <class F>
struct CoverageSum {
  Int_t<F> count, depths;  // lines that hit, and the sum of their depth codes
  Mask_t<F> unknown;       // lanes with a tile that is not baked
};

// Calls add_tile(lanes, first word, first column, first row) for each non-empty tile that the rectangles of the wanted
// lanes overlap. Rectangles lie within [0, L]^2 (unchecked). Returns the lanes that met tiles that are not baked;
// tell_missing(slots, mask) is called with their slots.
template <class F, class TellMissing, class AddTile>
FT_HD_INLINE Mask_t<F> visit_tiles(const CoverageView& view, Int_t<F> direction, const TexelRect<F>& rect,
                                   Mask_t<F> wanted, const TellMissing& tell_missing, const AddTile& add_tile) {
  const Int_t<F> zero = splat_int<F>(0);
  const Int_t<F> first_x = shift_right<5>(rect.x0), first_y = shift_right<5>(rect.y0);
  const Int_t<F> plane = direction * splat_int<F>(view.tiles * view.tiles);
  Mask_t<F> unknown = and_not(wanted, wanted);
  for (int j = 0; j < view.tiles; ++j) {
    const Int_t<F> tile_y = first_y + splat_int<F>(j), row = shift_left<5>(tile_y);
    const Mask_t<F> in_row = wanted & (max(rect.y0, row) < min(rect.y1, row + splat_int<F>(k_tile_lines)));
    if (!any(in_row)) break;
    for (int i = 0; i < view.tiles; ++i) {
      const Int_t<F> tile_x = first_x + splat_int<F>(i), column = shift_left<5>(tile_x);
      const Mask_t<F> inside = in_row & (max(rect.x0, column) < min(rect.x1, column + splat_int<F>(k_tile_lines)));
      if (!any(inside)) break;
      const Int_t<F> slot = select(inside, plane + tile_y * splat_int<F>(view.tiles) + tile_x, zero);
      const Int_t<F> tile = gather(view.tile_of, slot);
      order_loads();  // a baker publishes a tile's number last
      const Mask_t<F> missing = inside & (tile < splat_int<F>(1));
      if (any(missing)) {
        unknown = unknown | missing;
        tell_missing(slot, missing);
      }
      const Mask_t<F> filled = inside & (tile > splat_int<F>(1));
      if (any(filled)) add_tile(filled, tile * splat_int<F>(k_tile_words), column, row);
    }
  }
  return unknown;
}

// Sums over the rectangles of the wanted lanes.
template <class F, class TellMissing>
FT_HD_INLINE CoverageSum<F> sum_coverage(const CoverageView& view, Int_t<F> direction, const TexelRect<F>& rect,
                                         Mask_t<F> wanted, const TellMissing& tell_missing) {
  const Int_t<F> zero = splat_int<F>(0), length = splat_int<F>(k_tile_corners), side = splat_int<F>(k_tile_lines);
  CoverageSum<F> sum = {zero, zero, wanted};
  const auto add_tile = [&](Mask_t<F> filled, Int_t<F> base, Int_t<F> column, Int_t<F> row) {
    const Int_t<F> x0 = max(rect.x0 - column, zero), x1 = min(rect.x1 - column, side);
    const Int_t<F> low = base + max(rect.y0 - row, zero) * length, high = base + min(rect.y1 - row, side) * length;
    const auto corner = [&](Int_t<F> index) { return gather(view.sums, select(filled, index, zero)); };
    const Int_t<F> word = (corner(high + x1) - corner(high + x0)) - (corner(low + x1) - corner(low + x0));
    sum.count = sum.count + select(filled, word & splat_int<F>((1 << k_count_bits) - 1), zero);
    sum.depths = sum.depths + select(filled, shift_right<k_count_bits>(word), zero);
  };
  sum.unknown = visit_tiles<F>(view, direction, rect, wanted, tell_missing, add_tile);
  return sum;
}

// A rectangle in texels, with fractional edges.
template <class F>
struct PlaneRect {
  F x0, x1, y0, y1;
};

// The whole texels that contain the rectangle, clipped to the coverage map. Rectangles lie within [0, L]^2 (unchecked);
// the last row or column may begin at L, where there is no tile.
template <class F>
FT_HD_INLINE TexelRect<F> texels_about(const CoverageView& view, const PlaneRect<F>& rect) {
  const Int_t<F> one = splat_int<F>(1), lines = splat_int<F>(view.tiles * k_tile_lines);
  const auto texel = [](F x) { return small_to_int(floor(x)); };
  return {texel(rect.x0), min(texel(rect.x1) + one, lines), texel(rect.y0), min(texel(rect.y1) + one, lines)};
}

// Lines that hit in the rectangle's area, with boundary texels weighted by the part of them that lies inside.
template <class F>
struct CoverageArea {
  F count;
  Mask_t<F> unknown;
};

// The interval [begin, end) along one axis of a tile, clipped to the tile: four corners of its sums and their weights.
template <class F>
struct TileSpan {
  Int_t<F> corner[4];
  F weight[4];
};

template <class F>
FT_HD_INLINE TileSpan<F> span_in_tile(F begin, F end, Int_t<F> base) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), first = to_float(base);
  const auto clipped = [&](F x) { return min(max(x - first, zero), splat<F>(float(k_tile_lines))); };
  const auto texel = [](F x) { return min(floor(x), splat<F>(float(k_tile_lines - 1))); };
  const F low = clipped(begin), high = clipped(end), low_texel = texel(low), high_texel = texel(high);
  TileSpan<F> span;
  span.corner[0] = small_to_int(low_texel);
  span.corner[1] = span.corner[0] + splat_int<F>(1);
  span.corner[2] = small_to_int(high_texel);
  span.corner[3] = span.corner[2] + splat_int<F>(1);
  span.weight[1] = low_texel - low;
  span.weight[0] = (zero - one) - span.weight[1];
  span.weight[3] = high - high_texel;
  span.weight[2] = one - span.weight[3];
  return span;
}

// Rectangles lie within [0, L]^2 and are not empty (unchecked).
template <class F, class TellMissing>
FT_HD_INLINE CoverageArea<F> sum_coverage_area(const CoverageView& view, Int_t<F> direction, const PlaneRect<F>& rect,
                                               Mask_t<F> wanted, const TellMissing& tell_missing) {
  const F zero = splat<F>(0.0f);
  CoverageArea<F> area = {zero, wanted};
  const TexelRect<F> within = texels_about<F>(view, rect);
  const auto add_tile = [&](Mask_t<F> filled, Int_t<F> base, Int_t<F> column, Int_t<F> row) {
    const TileSpan<F> x = span_in_tile<F>(rect.x0, rect.x1, column), y = span_in_tile<F>(rect.y0, rect.y1, row);
    F count = zero;
    for (int j = 0; j < 4; ++j) {
      const Int_t<F> line = base + y.corner[j] * splat_int<F>(k_tile_corners);
      F row_count = zero;
      for (int i = 0; i < 4; ++i) {
        const Int_t<F> word = gather(view.sums, select(filled, line + x.corner[i], splat_int<F>(0)));
        row_count = row_count + to_float(word & splat_int<F>((1 << k_count_bits) - 1)) * x.weight[i];
      }
      count = count + row_count * y.weight[j];
    }
    area.count = area.count + select(filled, count, zero);
  };
  area.unknown = visit_tiles<F>(view, direction, within, wanted, tell_missing, add_tile);
  return area;
}

// Radiance summed over a rectangle's area, with boundary texels weighted as in CoverageArea. The tiles must be baked,
// which sum_coverage_area() over the same rectangle has shown.
template <class F>
struct RadianceSum {
  F red, green, blue;
};

template <class F>
FT_HD_INLINE RadianceSum<F> sum_radiance_area(const CoverageView& view, Int_t<F> direction, const PlaneRect<F>& rect,
                                              Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f);
  const TexelRect<F> within = texels_about<F>(view, rect);
  RadianceSum<F> sum = {zero, zero, zero};
  const auto add_tile = [&](Mask_t<F> filled, Int_t<F> base, Int_t<F> column, Int_t<F> row) {
    const TileSpan<F> x = span_in_tile<F>(rect.x0, rect.x1, column), y = span_in_tile<F>(rect.y0, rect.y1, row);
    RadianceSum<F> part = {zero, zero, zero};
    for (int j = 0; j < 4; ++j) {
      const Int_t<F> line = base + y.corner[j] * splat_int<F>(k_tile_corners);
      for (int i = 0; i < 4; ++i) {
        const Int_t<F> corner = select(filled, line + x.corner[i], splat_int<F>(0));
        const Int_t<F> first = corner + corner + corner;
        const F weight = x.weight[i] * y.weight[j];
        part.red = part.red + gather(view.radiance, first) * weight;
        part.green = part.green + gather(view.radiance, first + splat_int<F>(1)) * weight;
        part.blue = part.blue + gather(view.radiance, first + splat_int<F>(2)) * weight;
      }
    }
    sum.red = sum.red + select(filled, part.red, zero);
    sum.green = sum.green + select(filled, part.green, zero);
    sum.blue = sum.blue + select(filled, part.blue, zero);
  };
  visit_tiles<F>(
      view, direction, within, wanted, [](Int_t<F>, Mask_t<F>) {}, add_tile);
  return sum;
}

// Thin-feature ratio (k_tile_thin_features) of the tile that holds a texel; 0 where it is empty or not baked.
template <class F>
FT_HD_INLINE F thin_feature_ratio_at(const CoverageView& view, Int_t<F> direction, Int_t<F> x, Int_t<F> y,
                                     Mask_t<F> wanted) {
  const Int_t<F> zero = splat_int<F>(0), tiles = splat_int<F>(view.tiles);
  const Int_t<F> slot = (direction * tiles + shift_right<5>(y)) * tiles + shift_right<5>(x);
  const Int_t<F> tile = max(gather(view.tile_of, select(wanted, slot, zero)), zero);
  order_loads();
  const Int_t<F> steps = gather(view.sums, tile * splat_int<F>(k_tile_words) + splat_int<F>(k_tile_thin_features));
  return to_float(steps) * splat<F>(1.0f / k_thin_feature_steps);
}

FT_LANES_END

#endif  // toggled guard
