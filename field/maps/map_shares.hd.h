// Shares of direction cells that objects hide from shading points, read from direction maps.
//
// An object in front: a bilinear read of the mipmap of coverage whose texels match the cell's footprint at the object's
// centre plane (the tent and the texel together have the variance of the cell: texel = .58 x width), or, where the
// footprint is below a texel or a half, or the point lies within the object's ball, percentage-closer filtering of 2 x
// 2 depths (Reeves, Salesin, Cook, "Rendering Antialiased Shadows with Depth Maps", SIGGRAPH 1987), at four places
// where the cell is wider. The object that the point lies on: the same against the point's tangent plane, moved up by a
// bias that grows with its slope. Depths about as high as the point are undecided. Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_MAPS_MAP_SHARES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_MAP_SHARES_HD_H_
#undef FIELDTRACE_FIELD_MAPS_MAP_SHARES_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_MAP_SHARES_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_radiance.hd.h"
#include "field/maps/cell_task.h"

FT_LANES_BEGIN

// Of a read of 2 x 2 depths, the share of undecided ones above which it is undecided.
constexpr float k_most_near = 0.25f;
// A quarter of a cell's width, in footprints.
constexpr float k_quarter_of_cell = 0.25f / k_footprint;
// Footprints wider than this are broad, texels: half way, in powers of two, from the texels of the map to those of
// level 1 of its coverage.
constexpr float k_broad_footprint = 1.4142135f;

template <class F>
struct MapShare {
  F hidden;        // [0, 1]
  Mask_t<F> near;  // undecided
};

// 2 x 2 neighbouring depths of a map, and the weights of a bilinear read.
template <class F>
struct DepthTaps {
  F depth[4];
  F weight[4];
  F dx0, dy0;  // from the point to the first tap, texels
};

// Coordinates beyond [0, texels] read at the map's end.
template <class F>
FT_HD_INLINE DepthTaps<F> read_depths(const MapLines& lines, F x, F y, Mask_t<F> wanted) {
  const MapsView& maps = *lines.maps;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f), last = splat<F>(float(maps.texels - 2));
  const F x0 = within_table<F>(floor(x - half), last), y0 = within_table<F>(floor(y - half), last);
  const F fx = min(max(x - half - x0, zero), one), fy = min(max(y - half - y0, zero), one);
  const Int_t<F> texel = small_to_int(y0) * splat_int<F>(maps.texels) + small_to_int(x0);
  const Int_t<F> byte = select(wanted, texel + texel, splat_int<F>(0)) + splat_int<F>(lines.depth_begin);
  const Int_t<F> low = gather_bytes(maps.depth, byte);
  const Int_t<F> high = gather_bytes(maps.depth, byte + splat_int<F>(2 * maps.texels));
  const Int_t<F> word = splat_int<F>(0xffff);
  DepthTaps<F> taps;
  taps.depth[0] = to_float(low & word);
  taps.depth[1] = to_float(shift_right<16>(low) & word);
  taps.depth[2] = to_float(high & word);
  taps.depth[3] = to_float(shift_right<16>(high) & word);
  taps.weight[0] = (one - fx) * (one - fy);
  taps.weight[1] = fx * (one - fy);
  taps.weight[2] = (one - fx) * fy;
  taps.weight[3] = fx * fy;
  taps.dx0 = x0 + half - x;
  taps.dy0 = y0 + half - y;
  return taps;
}

template <class F>
FT_HD_INLINE MapShare<F> share_by_depth(const MapLines& lines, F x, F y, F z, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), codes = splat<F>(0.5f * k_depth_codes);
  const DepthTaps<F> taps = read_depths<F>(lines, x, y, wanted);
  const F code = splat<F>(1.0f) + (z + one) * codes, margin = splat<F>(lines.margin) * codes;
  F hidden = zero, near = zero;
  for (int i = 0; i < 4; ++i) {
    const F d = taps.depth[i];
    hidden = hidden + select(d > max(code, zero), taps.weight[i], zero);
    near = near + select((d > zero) & (abs(d - code) < margin), taps.weight[i], zero);
  }
  const Mask_t<F> undecided = wanted & (near > splat<F>(k_most_near));
  return {select(wanted, hidden, zero), undecided};
}

// Of cells that are wider than texels, by four of read(x, y), each `quarter` from the middle along x and y.
template <class F, class Read>
FT_HD_INLINE MapShare<F> share_by_four(F x, F y, F quarter, const Read& read) {
  const F zero = splat<F>(0.0f), part = splat<F>(0.25f);
  F hidden = zero, near = zero;
  for (int k = 0; k < 4; ++k) {
    const MapShare<F> share = read(k % 2 ? x + quarter : x - quarter, k / 2 ? y + quarter : y - quarter);
    hidden = hidden + part * share.hidden;
    near = near + select(share.near, part, zero);
  }
  return {hidden, near > splat<F>(k_most_near)};
}

// footprint: texels. A footprint wider than the map reads the coarsest level, and is hidden by the map's part of it.
template <class F>
FT_HD_INLINE F share_by_coverage(const MapLines& lines, F x, F y, F footprint, Mask_t<F> wanted) {
  const MapsView& maps = *lines.maps;
  const F zero = splat<F>(0.0f), half = splat<F>(0.5f);
  F scale = half;
  Int_t<F> begin = splat_int<F>(maps.level_begin[0]);
  float step = 0.5f, limit = 2.8284271f;  // half way, in powers of two, from the texels of level 1 to those of level 2
  for (int level = 2; level <= maps.levels; ++level) {
    step *= 0.5f;
    const Mask_t<F> coarser = footprint >= splat<F>(limit);
    scale = select(coarser, splat<F>(step), scale);
    begin = select(coarser, splat_int<F>(maps.level_begin[level - 1]), begin);
    limit *= 2.0f;
  }
  const F texels = splat<F>(float(maps.texels)), middle = splat<F>(0.5f * float(maps.texels));
  const F shrink = texels / max(footprint, texels);
  const F column = ((x - middle) * shrink + middle) * scale + half,
          row = ((y - middle) * shrink + middle) * scale + half;
  const F entries = texels * scale + splat<F>(1.0f);
  const Mask_t<F> read = wanted & (column >= zero) & (row >= zero) & (column < entries) & (row < entries);
  const F x0 = select(read, floor(column), zero), y0 = select(read, floor(row), zero);
  const Int_t<F> entry = small_to_int(y0) * small_to_int(entries) + small_to_int(x0);
  const Int_t<F> word = gather_bytes(maps.coverage, splat_int<F>(lines.coverage_begin) + begin + shift_left<2>(entry));
  const Int_t<F> byte = splat_int<F>(0xff);
  const F c00 = to_float(word & byte), c10 = to_float(shift_right<8>(word) & byte);
  const F c01 = to_float(shift_right<16>(word) & byte), c11 = to_float(shift_right<24>(word) & byte);
  const F fx = column - x0, fy = row - y0;
  const F upper = c00 + (c10 - c00) * fx, lower = c01 + (c11 - c01) * fx;
  return select(read, (upper + (lower - upper) * fy) * splat<F>(1.0f / 255.0f) * (shrink * shrink), zero);
}

// Where the lines through points read a map.
template <class F>
struct MapPlace {
  F x, y, z;           // texels, and the point's coordinate
  F footprint;         // texels
  Mask_t<F> inside;    // something may be read
  Mask_t<F> by_share;  // by coverage
  Mask_t<F> by_depth;
};

// lean: how far each point turns from the cell's direction, to the middle of what its cosine leaves of the cell.
template <class F>
FT_HD_INLINE MapPlace<F> place_in_map(const MapLines& lines, const Vec3Lanes<F>& p, const Vec3Lanes<F>& lean) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), texels = splat<F>(float(lines.maps->texels));
  const F middle = splat<F>(0.5f * float(lines.maps->texels)), per_texel = splat<F>(2.0f / float(lines.maps->texels));
  const F z = affine<F>(lines.z, p), ahead_of_point = max(zero - z, zero);
  const F on_line_x = affine<F>(lines.u, p), on_line_y = affine<F>(lines.v, p);
  const F across_x = (on_line_x - middle) * per_texel, across_y = (on_line_y - middle) * per_texel;
  const F from_centre = across_x * across_x + across_y * across_y + z * z;  // squared
  // Points outside the ball follow their ray to the centre plane. Within, what hides them may be nearer: the nearer
  // they are to the centre, the more the map's own line stands for the ray.
  const F rise = min(from_centre, one) * ahead_of_point;
  F x = on_line_x + splat<F>(lines.slope_u) * rise, y = on_line_y + splat<F>(lines.slope_v) * rise;
  const F footprint = splat<F>(lines.reach) * ahead_of_point;
  const Mask_t<F> ahead = z < one;
  // Within the map and one and a half of the texels that are read. Without the lean, which culling does not know.
  const F reach = middle + splat<F>(1.5f * 1.4142136f) * footprint;
  const Mask_t<F> inside = ahead & (abs(x - middle) <= reach) & (abs(y - middle) <= reach);
  // To first order. The part of the lean along the cell's direction moves nothing.
  const F aside = ahead_of_point * splat<F>(lines.per_z), lean_z = dot3<F>(lines.z, lean);
  x = x + (dot3<F>(lines.u, lean) - splat<F>(lines.slope_u) * lean_z) * aside;
  y = y + (dot3<F>(lines.v, lean) - splat<F>(lines.slope_v) * lean_z) * aside;
  const Mask_t<F> before = (z < zero) & (from_centre > one);
  const Mask_t<F> wide = inside & before & (footprint >= splat<F>(k_broad_footprint));
  const Mask_t<F> fine = and_not(wide, inside) & (x >= zero) & (y >= zero) & (x <= texels) & (y <= texels);
  return {x, y, z, footprint, inside, wide, fine};
}

// Of an object that the points do not lie on.
template <class F>
FT_HD_INLINE MapShare<F> share_of_map(const MapLines& lines, const MapPlace<F>& at) {
  MapShare<F> share = {splat<F>(0.0f), and_not(at.inside, at.inside)};
  if (!any(at.inside)) return share;
  const Mask_t<F> broad = at.by_depth & (at.footprint >= splat<F>(k_broad_footprint));
  if (any(and_not(broad, at.by_depth))) share = share_by_depth<F>(lines, at.x, at.y, at.z, at.by_depth);
  if (any(broad)) {
    const MapShare<F> wide = share_by_four<F>(at.x, at.y, splat<F>(k_quarter_of_cell) * at.footprint,
                                              [&](F x, F y) { return share_by_depth<F>(lines, x, y, at.z, broad); });
    share.hidden = select(broad, wide.hidden, share.hidden);
    share.near = and_not(broad, share.near) | wide.near;
  }
  if (any(at.by_share)) {
    const F covered = share_by_coverage<F>(lines, at.x, at.y, at.footprint, at.by_share);
    share.hidden = select(at.by_share, covered, share.hidden);
  }
  return share;
}

template <class F>
FT_HD_INLINE MapShare<F> share_of_map(const MapLines& lines, const Vec3Lanes<F>& p, const Vec3Lanes<F>& lean) {
  return share_of_map<F>(lines, place_in_map<F>(lines, p, lean));
}

// Of the object that the points lie on; g: their geometric normals, world space. `k_within`: what rises above the
// tangent plane beyond MapLines::within is undecided, since nearer surfaces may lie beneath it.
template <class F, bool k_within = false>
FT_HD_INLINE MapShare<F> share_of_own(const OwnLines& own, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const MapLines& lines = own.lines;
  const F texels = splat<F>(float(lines.maps->texels));
  const F x = min(max(affine<F>(lines.u, p), zero), texels), y = min(max(affine<F>(lines.v, p), zero), texels);
  const F code = one + (affine<F>(lines.z, p) + one) * splat<F>(0.5f * k_depth_codes);
  const F facing = dot3<F>(own.c, g);
  const Mask_t<F> rises = facing > zero;
  const F inverse = one / select(rises, facing, one);
  const F per_texel = splat<F>(k_depth_codes / float(lines.maps->texels));
  const F slope_x = zero - dot3<F>(own.s, g) * inverse, slope_y = zero - dot3<F>(own.t, g) * inverse;
  const F steep = (one + abs(slope_x) + abs(slope_y)) * per_texel;
  const F low = steep * splat<F>(own.clear_within), high = steep * splat<F>(own.hidden_from);
  const DepthTaps<F> taps = read_depths<F>(lines, x, y, rises);
  F hidden = zero, near = zero;
  for (int i = 0; i < 4; ++i) {
    const F dx = taps.dx0 + splat<F>(float(i % 2)), dy = taps.dy0 + splat<F>(float(i / 2));
    const F above = taps.depth[i] - (code + (slope_x * dx + slope_y * dy) * per_texel);
    Mask_t<F> is_hidden = above > high;
    if constexpr (k_within) {
      is_hidden = is_hidden & (taps.depth[i] <= code + splat<F>(lines.within * (0.5f * k_depth_codes)));
    }
    hidden = hidden + select(is_hidden, taps.weight[i], zero);
    near = near + select(and_not(is_hidden, above > low), taps.weight[i], zero);
  }
  const Mask_t<F> undecided = !rises | (near > splat<F>(k_most_near));
  return {select(rises, hidden, zero), undecided};
}

FT_LANES_END

#endif  // toggled guard
