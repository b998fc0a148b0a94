// What a batch of shading points sees of one direction cell within a distance: farther surfaces hide nothing.
//
// Of an object in front, the first surface along the cell counts: the highest in the map of the opposite direction,
// whose lines are the same. It decides for points that lie before it. Points between the first surface of a line and
// its last are decided by the last where that lies within the distance. Where cells are wider than texels, the part of
// the coverage that lies within the distance is that of depths spread evenly, with the mean and the variance of a few
// reads (as in Donnelly, Lauritzen, "Variance Shadow Maps", I3D 2006, with an even spread in place of a bound).
// The points' own object is seen from outside: where its last surface lies beyond the distance, nothing is known.
// Thread-safety: pure functions over a CellTask.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_WITHIN_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_WITHIN_HD_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_WITHIN_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_WITHIN_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_task.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/maps/map_shares.hd.h"

FT_LANES_BEGIN

// The depths of the first surfaces of the lines that read_depths() reads, as codes of the same map; 0: none.
template <class F>
FT_HD_INLINE DepthTaps<F> read_first(const MapLines& lines, F x, F y, Mask_t<F> wanted) {
  MapLines back = lines;
  back.depth_begin = lines.back_begin;
  // Frames of opposite directions have the same s, and opposite t and c: row 0 there is the last one here. Read between
  // the two rows, so that they are those of read_depths() wherever y lies.
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f), ends = splat<F>(k_depth_codes + 2.0f);
  const F row = within_table<F>(floor(y - half), splat<F>(float(lines.maps->texels - 2)));
  const F fy = min(max(y - half - row, zero), one);
  DepthTaps<F> taps = read_depths<F>(back, x, splat<F>(float(lines.maps->texels - 1)) - row, wanted);
  for (int i = 0; i < 4; ++i) {
    taps.depth[i] = select(taps.depth[i] > zero, ends - taps.depth[i], zero);
    taps.weight[i] = (taps.weight[i] + taps.weight[i]) * (i < 2 ? fy : one - fy);
  }
  return taps;
}

// Of what hides the points, the part that lies within the distance: `far`, a code. Wide cells.
template <class F>
FT_HD_INLINE F part_within(const MapLines& lines, const MapPlace<F>& at, F far, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), quarter = splat<F>(k_quarter_of_cell) * at.footprint;
  F weight = zero, sum = zero, squares = zero;
  for (int k = 0; k < 4; ++k) {
    const F x = k % 2 ? at.x + quarter : at.x - quarter, y = k / 2 ? at.y + quarter : at.y - quarter;
    const DepthTaps<F> taps = read_first<F>(lines, x, y, wanted);
    for (int i = 0; i < 4; ++i) {
      const F w = select(taps.depth[i] > zero, taps.weight[i], zero), d = taps.depth[i] - far;
      weight = weight + w, sum = sum + w * d, squares = squares + w * d * d;
    }
  }
  // Without any reads, the object's middle.
  const F middle = splat<F>(1.0f + 0.5f * k_depth_codes) - far;
  const Mask_t<F> known = weight > zero;
  const F inverse = one / select(known, weight, one), mean = select(known, sum * inverse, middle);
  const F variance = max(squares * inverse - mean * mean, zero);
  // At least a texel deep.
  const F least = splat<F>(k_depth_codes / float(lines.maps->texels));
  const F spread = max(sqrt(splat<F>(3.0f) * variance), least);
  return min(max(splat<F>(0.5f) - mean / (spread + spread), zero), one);
}

// By the first and the last surface of 2 x 2 lines.
template <class F>
FT_HD_INLINE MapShare<F> share_by_lines_within(const MapLines& lines, F x, F y, F code, F far, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f), margin = splat<F>(lines.margin * (0.5f * k_depth_codes));
  const DepthTaps<F> taps = read_depths<F>(lines, x, y, wanted);
  const DepthTaps<F> back = read_first<F>(lines, x, y, wanted);
  F hidden = zero, near = zero;
  for (int i = 0; i < 4; ++i) {
    const F last = taps.depth[i];
    // The rows of the opposite map run the other way.
    const F first = select(back.depth[i ^ 2] > zero, back.depth[i ^ 2], last);
    const Mask_t<F> ends_within = last <= far, begins_behind = first <= code;
    const Mask_t<F> is_hidden = (last > max(code, zero)) & (ends_within | and_not(begins_behind, first <= far));
    const F decides = select(ends_within, last, first);
    const Mask_t<F> is_near = (abs(decides - code) < margin) | and_not(ends_within, begins_behind);
    hidden = hidden + select(is_hidden, taps.weight[i], zero);
    near = near + select((last > zero) & is_near, taps.weight[i], zero);
  }
  const Mask_t<F> undecided = wanted & (near > splat<F>(k_most_near));
  return {select(wanted, hidden, zero), undecided};
}

// The same; of cells that are wider than texels by four reads.
template <class F>
FT_HD_INLINE MapShare<F> share_by_depths_within(const MapLines& lines, const MapPlace<F>& at, F code, F far,
                                                Mask_t<F> wanted) {
  const Mask_t<F> broad = wanted & (at.footprint >= splat<F>(k_broad_footprint));
  if (!any(broad)) return share_by_lines_within<F>(lines, at.x, at.y, code, far, wanted);
  // Elsewhere the four places are one.
  const F quarter = select(broad, splat<F>(k_quarter_of_cell) * at.footprint, splat<F>(0.0f));
  return share_by_four<F>(at.x, at.y, quarter,
                          [&](F x, F y) { return share_by_lines_within<F>(lines, x, y, code, far, wanted); });
}

// Of an object that the points do not lie on.
template <class F>
FT_HD_INLINE MapShare<F> share_of_map_within(const MapLines& lines, const Vec3Lanes<F>& p, const Vec3Lanes<F>& lean) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  MapPlace<F> at = place_in_map<F>(lines, p, lean);
  const F reach = at.z + splat<F>(lines.within);
  const Mask_t<F> reached = reach > zero - one, cut = reached & (reach < one);
  at.inside = at.inside & reached, at.by_share = at.by_share & reached;
  const Mask_t<F> by_depth = at.by_depth & cut, by_share = at.by_share & cut;
  at.by_depth = and_not(cut, at.by_depth & reached);
  MapShare<F> share = share_of_map<F>(lines, at);
  if (!any(by_depth | by_share)) return share;
  const F codes = splat<F>(0.5f * k_depth_codes), code = one + (at.z + one) * codes;
  const F far = code + splat<F>(lines.within) * codes;
  if (any(by_share)) {
    share.hidden = select(by_share, share.hidden * part_within<F>(lines, at, far, by_share), share.hidden);
  }
  if (any(by_depth)) {
    const MapShare<F> by_depths = share_by_depths_within<F>(lines, at, code, far, by_depth);
    share.hidden = select(by_depth, by_depths.hidden, share.hidden);
    share.near = share.near | by_depths.near;
  }
  return share;
}

// Of the part `share` of a cell that meets a plane, what does so within the distance: a cone about the plane's normal,
// which lies within the half-space that heads for the plane.
template <class F>
FT_HD_INLINE F share_of_plane_within(const PlaneLines& plane, F share, float half, float within,
                                     const Vec3Lanes<F>& p) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), middle = splat<F>(0.5f);
  const F height = height_over<F>(plane, p), fall = nearing<F>(plane.centre, height);
  const F heading = min(max(fall * splat<F>(0.5f / half) + middle, zero), one);
  // Over a square of half width h about a direction of cosine f, the cosine has the mean f (1 - h^2 / 3). It changes
  // by sqrt(1 - f^2) h to each side, and by h^2 / 2 about the normal, where it is level.
  const F mean = fall * splat<F>(1.0f - half * half / 3.0f);
  const F spread = splat<F>(half) * sqrt(max(one - fall * fall, zero) + splat<F>(0.25f * half * half));
  const F above = mean - abs(height) * splat<F>(1.0f / within);
  const F in_cone = min(max(above / (spread + spread) + middle, zero), heading);
  return share * in_cone / max(heading, splat<F>(1e-12f));
}

template <class F>
FT_HD_INLINE CellSeen<F> look_at_cell_within(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                             const Vec3Lanes<F>& s, F cosine) {
  const auto limit = [&](const PlaneLines& plane, F share) {
    if (!any(share > splat<F>(0.0f))) return share;
    return share_of_plane_within<F>(plane, share, task.cosine_half, task.within, p);
  };
  return look_at_objects<F>(
      task, p, g, s, cosine, [&] { return share_of_own<F, true>(*task.own, p, g); },
      [&](const MapLines& lines, const Vec3Lanes<F>& lean) { return share_of_map_within<F>(lines, p, lean); },
      [&] { return PlanesSeen<F>(task, p, s, limit).clear(); });
}

template <class F>
struct LookAtCellWithin {
  static FT_HD_INLINE CellSeen<F> look(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                       const Vec3Lanes<F>& s, F cosine, int32_t) {
    return look_at_cell_within<F>(task, p, g, s, cosine);
  }
};

// As see_cell(), of a task that knows a distance and does not reflect.
template <class F>
FT_HD_INLINE int see_cell_within(const CellTask& task, const CellPoints& points, const CellSums& sums,
                                 int32_t* undecided) {
  return see_cell_by<F, LookAtCellWithin<F>>(task, points, sums, undecided);
}

FT_LANES_END

#endif  // toggled guard
