// What a batch of shading points sees of one direction cell of the sky, read from direction maps.
//
// An object in front: a bilinear read of the mipmap of coverage whose texels match the cell's footprint at the object's
// centre plane (the tent and the texel together have the variance of the cell: texel = .58 x width), or, where the
// footprint is below a texel or a half, or the point lies within the object's ball, percentage-closer filtering of 2 x
// 2 depths (Reeves, Salesin, Cook, "Rendering Antialiased Shadows with Depth Maps", SIGGRAPH 1987). The object that the
// point lies on: the same against the point's tangent plane, moved up by a bias that grows with its slope. Shares
// multiply. Depths about as high as the point are undecided, and with them the cell.
// Thread-safety: pure functions over a CellTask.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_task.h"

FT_LANES_BEGIN

// Of a read of 2 x 2 depths, the share of undecided ones above which it is undecided.
constexpr float k_most_near = 0.25f;
// Below this share a cell counts as hidden whatever is undecided.
constexpr float k_least_clear = 0.004f;
// Cells whose direction rises less above the tangent plane (sine) are undecided on the object itself.
constexpr float k_least_rise = 0.05f;

template <class F>
FT_HD_INLINE F affine(const float* row, const Vec3Lanes<F>& p) {
  return splat<F>(row[0]) * p.x + splat<F>(row[1]) * p.y + splat<F>(row[2]) * p.z + splat<F>(row[3]);
}

template <class F>
FT_HD_INLINE F dot3(const float* a, const Vec3Lanes<F>& b) {
  return splat<F>(a[0]) * b.x + splat<F>(a[1]) * b.y + splat<F>(a[2]) * b.z;
}

// The mean of max(0, x) for x uniform in [mean - half, mean + half]: of the cosine over a cell across the horizon.
// Without a condition, so that compilers make vectors of loops over floats, too.
template <class F>
FT_HD_INLINE F cosine_over_cell(F mean, F half) {
  const F zero = splat<F>(0.0f);
  const F across = min(max(mean + half, zero), half + half);
  return across * across / (splat<F>(4.0f) * half) + max(mean - half, zero);
}

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

// x, y: within [0, texels].
template <class F>
FT_HD_INLINE DepthTaps<F> read_depths(const MapLines& lines, F x, F y, Mask_t<F> wanted) {
  const MapsView& maps = *lines.maps;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f), last = splat<F>(float(maps.texels - 2));
  const F x0 = min(max(floor(x - half), zero), last), y0 = min(max(floor(y - half), zero), last);
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

// Of an object that the points do not lie on.
template <class F>
FT_HD_INLINE MapShare<F> share_of_map(const MapLines& lines, const Vec3Lanes<F>& p) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), texels = splat<F>(float(lines.maps->texels));
  const F z = affine<F>(lines.z, p);
  // Far points follow their ray to the centre plane. In the ball, where contacts matter, the map's own line stands for
  // it, half a cell away at most.
  const F rise = min(max(zero - one - z, zero), one) * (zero - z);
  const F x = affine<F>(lines.u, p) + splat<F>(lines.slope_u) * rise;
  const F y = affine<F>(lines.v, p) + splat<F>(lines.slope_v) * rise;
  const F footprint = splat<F>(lines.reach) * max(zero - z, zero);
  const Mask_t<F> ahead = z < one;
  // Within the map and one and a half of the texels that are read.
  const F middle = splat<F>(0.5f * float(lines.maps->texels));
  const F reach = middle + splat<F>(1.5f * 1.4142136f) * footprint;
  const Mask_t<F> inside = ahead & (abs(x - middle) <= reach) & (abs(y - middle) <= reach);
  if (!any(inside)) return {zero, and_not(ahead, ahead)};
  const Mask_t<F> wide = inside & (z < zero - one) & (footprint >= splat<F>(1.4142135f));
  MapShare<F> share = {zero, and_not(ahead, ahead)};
  const Mask_t<F> fine = and_not(wide, ahead) & (x >= zero) & (y >= zero) & (x <= texels) & (y <= texels);
  if (any(fine)) share = share_by_depth<F>(lines, x, y, z, fine);
  if (any(wide)) share.hidden = select(wide, share_by_coverage<F>(lines, x, y, footprint, wide), share.hidden);
  return share;
}

// Of the object that the points lie on; g: their geometric normals, world space.
template <class F>
FT_HD_INLINE MapShare<F> share_of_own(const OwnLines& own, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const MapLines& lines = own.lines;
  const F texels = splat<F>(float(lines.maps->texels));
  const F x = min(max(affine<F>(lines.u, p), zero), texels), y = min(max(affine<F>(lines.v, p), zero), texels);
  const F code = one + (affine<F>(lines.z, p) + one) * splat<F>(0.5f * k_depth_codes);
  const F facing = dot3<F>(own.c, g);
  const Mask_t<F> rises = facing > splat<F>(k_least_rise);
  const F inverse = one / max(facing, splat<F>(k_least_rise));
  const F per_texel = splat<F>(k_depth_codes / float(lines.maps->texels));
  const F slope_x = zero - dot3<F>(own.s, g) * inverse, slope_y = zero - dot3<F>(own.t, g) * inverse;
  const F steep = (one + abs(slope_x) + abs(slope_y)) * per_texel;
  const F low = steep * splat<F>(own.clear_within), high = steep * splat<F>(own.hidden_from);
  const DepthTaps<F> taps = read_depths<F>(lines, x, y, rises);
  F hidden = zero, near = zero;
  for (int i = 0; i < 4; ++i) {
    const F dx = taps.dx0 + splat<F>(float(i % 2)), dy = taps.dy0 + splat<F>(float(i / 2));
    const F above = taps.depth[i] - (code + (slope_x * dx + slope_y * dy) * per_texel);
    const Mask_t<F> is_hidden = above > high;
    hidden = hidden + select(is_hidden, taps.weight[i], zero);
    near = near + select(and_not(is_hidden, above > low), taps.weight[i], zero);
  }
  const Mask_t<F> undecided = !rises | (near > splat<F>(k_most_near));
  return {select(rises, hidden, zero), undecided};
}

// Share of a cell within two half-spaces through the point, from the shares in each and the cosine between their
// normals: nested, independent or opposite.
template <class F>
FT_HD_INLINE F share_of_both(F a, F b, F cosine) {
  const F zero = splat<F>(0.0f), product = a * b;
  const F limit = select(cosine > zero, min(a, b), max(a + b - splat<F>(1.0f), zero));
  return product + (limit - product) * abs(cosine);
}

// Share of a cell that a parallelogram hides. Each edge spans a plane with the point, which cuts the cell at the cell
// centre's distance from it; so the answer is right for edges near and far, and at the plane's horizon.
template <class F>
FT_HD_INLINE F share_of_slope(const PlaneLines& plane, const PlaneSlope& slope, float half, const Vec3Lanes<F>& p) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half_share = splat<F>(0.5f), per_width = splat<F>(0.5f / half);
  const F height = affine<F>(plane.height, p), h = abs(height);
  const F fall = select(height > zero, splat<F>(-slope.rise), splat<F>(slope.rise));
  const auto share = [&](F distance) { return min(max(distance * per_width + half_share, zero), one); };
  const auto within = [&](const float* row, float change, float per_unit) {
    const F at = affine<F>(row, p), up = one - at, down = one + at, move = h * splat<F>(change);
    const F aside = h * h * splat<F>(per_unit);
    const F upper = sqrt(up * up + aside), lower = sqrt(down * down + aside);
    const F tiny = splat<F>(1e-12f);
    const F a = share((fall * up - move) / max(upper, tiny)), b = share((fall * down + move) / max(lower, tiny));
    return share_of_both<F>(a, b, (up * down - aside) / max(upper * lower, tiny));
  };
  const F x = within(plane.x, slope.dx, plane.per_unit_x), y = within(plane.y, slope.dy, plane.per_unit_y);
  const F heading = share(fall);  // the part of the cell that heads for the plane
  return min(x * y / max(heading, splat<F>(1e-6f)), heading);
}

// Of the cell's light, where it varies over the cell.
template <class F>
FT_HD_INLINE F share_of_plane(const PlaneLines& plane, const CellTask& task, const Vec3Lanes<F>& p) {
  const F whole = share_of_slope<F>(plane, plane.centre, task.half, p);
  const Mask_t<F> partly = (whole > splat<F>(0.0f)) & (whole < splat<F>(1.0f));
  if (!task.parts || !any(partly)) return whole;
  F share = splat<F>(0.0f);
  for (int k = 0; k < k_cell_parts; ++k) {
    const F of_part = share_of_slope<F>(plane, plane.parts[k], task.half / float(k_parts_side), p);
    share = share + of_part * splat<F>(task.parts[k]);
  }
  return select(partly, share, whole);
}

// Whether the cell may meet the ball.
template <class F>
FT_HD_INLINE Mask_t<F> may_meet(const BallLines& ball, const CellTask& task, const Vec3Lanes<F>& p) {
  const Vec3Lanes<F> to = {splat<F>(ball.centre[0]) - p.x, splat<F>(ball.centre[1]) - p.y,
                           splat<F>(ball.centre[2]) - p.z};
  const F along = dot3<F>(task.direction, to), zero = splat<F>(0.0f), radius = splat<F>(ball.radius);
  const F reach = radius + splat<F>(1.5f * task.half) * max(along, zero);
  return (along > zero - radius) & (dot(to, to) - along * along <= reach * reach);
}

// Adds what the cell's hidden and undecided parts take from the points' irradiance. Lists the points for which it is
// undecided in `undecided`, which has room for all and a vector more, and returns their number.
template <class F>
FT_HD_INLINE int see_cell(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  constexpr int k_count = Lanes<F>::k_count;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  int listed = 0;
  for (int32_t i = 0; i < points.size; i += k_count) {
    const Vec3Lanes<F> s = {load_lanes<F>(points.sx + i), load_lanes<F>(points.sy + i), load_lanes<F>(points.sz + i)};
    const F cosine = cosine_over_cell<F>(dot3<F>(task.vector, s), splat<F>(task.cosine_half));
    const Mask_t<F> lit = cosine > zero;
    if (!any(lit)) continue;
    const Vec3Lanes<F> p = {load_lanes<F>(points.px + i), load_lanes<F>(points.py + i), load_lanes<F>(points.pz + i)};
    F clear = one;
    Mask_t<F> near = and_not(lit, lit);
    const auto hide = [&](const MapShare<F>& share) {
      clear = select(share.near, clear, clear * (one - share.hidden));
      near = near | share.near;
    };
    for (int k = 0; k < task.plane_count; ++k) clear = clear * (one - share_of_plane<F>(task.planes[k], task, p));
    if (task.own) {
      const Vec3Lanes<F> g = {load_lanes<F>(points.gx + i), load_lanes<F>(points.gy + i), load_lanes<F>(points.gz + i)};
      hide(share_of_own<F>(*task.own, p, g));
    }
    for (int k = 0; k < task.map_count; ++k) {
      if (!any(clear > splat<F>(k_least_clear))) break;
      hide(share_of_map<F>(task.maps[k], p));
    }
    for (int k = 0; k < task.ball_count; ++k) near = near | may_meet<F>(task.balls[k], task, p);
    // Whatever other lanes went on for.
    clear = select(clear > splat<F>(k_least_clear), clear, zero);
    const Mask_t<F> open = near & lit & (clear > zero);
    const F taken = select(open, one, one - clear) * cosine;
    const auto add = [&](float* sum, float weight) { store_lanes(load_lanes<F>(sum) + taken * splat<F>(weight), sum); };
    add(sums.red + i, task.weight[0]);
    add(sums.green + i, task.weight[1]);
    add(sums.blue + i, task.weight[2]);
    if (any(open)) listed += compress_store(lane_sequence<F>(i), open, undecided + listed);
  }
  return listed;
}

FT_LANES_END

#endif  // toggled guard
