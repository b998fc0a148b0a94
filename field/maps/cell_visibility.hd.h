// What a batch of shading points sees of one direction cell of the sky, read from direction maps.
//
// What objects leave clear (map_shares.hd.h) and what parallelograms do multiply. Where a map leaves an object
// undecided, the cell is. Thread-safety: pure functions over a CellTask.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_VISIBILITY_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_irradiance.hd.h"
#include "field/maps/cell_radiance.hd.h"
#include "field/maps/cell_task.h"
#include "field/maps/map_shares.hd.h"

FT_LANES_BEGIN

// Rays tell which part of a parallelogram is seen where another or an object hides some of it, and where its radiance
// varies by this much of its mean: what stands before a bright spot may hide all of it.
constexpr float k_most_uneven = 1.0f;
// What is left of a cell that is hidden whole: weights of a read add up to 1 but for rounding.
constexpr float k_hidden_rounding = 1e-6f;

// The share of cosine_over_cell(shading, half), above 0, that lies above a second horizon, at which a cell's centre has
// the cosine `geometric`. `turn`: the cosine between the two normals. 1 where the normals agree.
template <class F>
FT_HD_INLINE F share_above(F cosine, F shading, F geometric, F turn, float half) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), h = splat<F>(half), two = splat<F>(2.0f);
  // Over the part above the second horizon, from `low` to `half` along its normal, the first cosine has this mean and,
  // as along both sides of the part, this half width.
  const F low = min(max(zero - geometric, zero - h), h), along = turn * (h - low) / two;
  const F middle = shading + turn * (h + low) / two;
  const F wide = sqrt(along * along + max(one - turn * turn, zero) * h * h);
  const F lit = cosine_over_cell<F>(middle, max(wide, splat<F>(1e-6f) * h)) * (h - low) / (two * h);
  return min(lit / max(cosine, splat<F>(1e-20f)), one);
}

// Share of a cell within two half-spaces through the point, from the shares in each and the cosine between their
// normals: nested, independent or opposite.
template <class F>
FT_HD_INLINE F share_of_both(F a, F b, F cosine) {
  const F zero = splat<F>(0.0f), product = a * b;
  const F limit = select(cosine > zero, min(a, b), max(a + b - splat<F>(1.0f), zero));
  return max(product + (limit - product) * abs(cosine), zero);
}

// The larger a share of two half-spaces is than if they were independent.
template <class F>
FT_HD_INLINE F relative_overlap(F a, F b, F cosine) {
  return share_of_both<F>(a, b, cosine) / max(a * b, splat<F>(1e-6f));
}

// The plane through a point and an edge of a parallelogram, as a half-space with the parallelogram inside.
template <class F>
struct EdgeCut {
  F share;              // of the cell
  F of_height, of_row;  // the unit normal: a sum of the gradients of the height and of the edge's coordinate
};

template <class F>
FT_HD_INLINE F nearing(const PlaneSlope& slope, F height) {  // how fast a direction nears the plane
  return select(height > splat<F>(0.0f), splat<F>(-slope.rise), splat<F>(slope.rise));
}

// Of the points over the parallelogram. What lies in the plane of a one-sided one lies before it.
template <class F>
FT_HD_INLINE F height_over(const PlaneLines& plane, const Vec3Lanes<F>& p) {
  const F height = affine<F>(plane.height, p);
  return plane.one_sided ? max(height, splat<F>(1e-30f)) : height;
}

// How the edges at the coordinate's ends cut a cell: by the distance of its centre from the planes through the point
// and them.
template <class F>
FT_HD_INLINE void cut_by_edges(const float* row, float change, float per_unit, F height, F fall, float half,
                               const Vec3Lanes<F>& p, EdgeCut<F> cuts[2]) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), h = abs(height);
  const F sign = select(height > zero, zero - one, one);
  const F at = affine<F>(row, p), move = h * splat<F>(change), aside = h * h * splat<F>(per_unit);
  for (int k = 0; k < 2; ++k) {
    const F side = splat<F>(k == 0 ? 1.0f : -1.0f), within = one - side * at;
    const F inverse = one / max(sqrt(within * within + aside), splat<F>(1e-12f));
    const F share = (fall * within - side * move) * inverse * splat<F>(0.5f / half) + splat<F>(0.5f);
    cuts[k] = {min(max(share, zero), one), sign * within * inverse, zero - side * h * inverse};
  }
}

template <class F>
FT_HD_INLINE F cosine_between(const EdgeCut<F>& a, const EdgeCut<F>& b, float row_product) {
  return a.of_height * b.of_height + a.of_row * b.of_row * splat<F>(row_product);
}

// Share of a cell that a parallelogram hides: right for edges near and far, and at the plane's horizon.
template <class F>
FT_HD_INLINE F share_of_slope(const PlaneLines& plane, const PlaneSlope& slope, float half, const Vec3Lanes<F>& p) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const F height = height_over<F>(plane, p), fall = nearing<F>(slope, height);
  // The part that heads for the plane.
  const F heading = min(max(fall * splat<F>(0.5f / half) + splat<F>(0.5f), zero), one);
  if (!any(heading > zero)) return zero;
  // Most cells lie wholly within an edge's half-space or outside: the distance of their centre from its plane is
  // bounded without a root.
  Mask_t<F> inside = fall >= splat<F>(half), outside = fall <= splat<F>(-half);
  const auto place = [&](const float* row, float change, float per_unit) {
    const F h = abs(height), at = affine<F>(row, p), move = h * splat<F>(change);
    const F width = splat<F>(half * 1.0001f), aside = h * sqrt(splat<F>(per_unit));
    const F up = one - at, down = one + at;
    const F above = fall * up - move, below = fall * down + move;
    const F most_up = width * (abs(up) + aside), most_down = width * (abs(down) + aside);
    inside = inside & (above >= most_up) & (below >= most_down);
    outside = outside | (above <= zero - most_up) | (below <= zero - most_down);
  };
  place(plane.x, slope.dx, plane.per_unit_x);
  place(plane.y, slope.dy, plane.per_unit_y);
  if (all(inside | outside)) return select(inside, one, zero);
  // Cuts round; what is bounded stays as it is, whatever other lanes go on for.
  const auto bounded = [&](F share) { return select(inside, one, select(outside, zero, share)); };
  EdgeCut<F> x[2], y[2];
  cut_by_edges<F>(plane.x, slope.dx, plane.per_unit_x, height, fall, half, p, x);
  const F of_x = share_of_both<F>(x[0].share, x[1].share, cosine_between<F>(x[0], x[1], plane.per_unit_x));
  if (!any(of_x > zero)) return bounded(zero);
  cut_by_edges<F>(plane.y, slope.dy, plane.per_unit_y, height, fall, half, p, y);
  const F of_y = share_of_both<F>(y[0].share, y[1].share, cosine_between<F>(y[0], y[1], plane.per_unit_y));
  const F share = min(min(of_x, of_y), heading);
  const Mask_t<F> cut_twice = (share > zero) & (max(of_x, of_y) < one);
  if (!any(cut_twice)) return bounded(share);
  F least = one, most = one;
  for (int i = 0; i < 4; ++i) {
    const EdgeCut<F>&a = x[i / 2], &b = y[i % 2];
    const F relative = relative_overlap<F>(a.share, b.share, cosine_between<F>(a, b, plane.x_dot_y));
    least = min(least, relative), most = max(most, relative);
  }
  return bounded(select(cut_twice, min(of_x * of_y * (least * most), share), share));
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

// A half-space through a point, and its share of a cell.
template <class F>
struct CellCut {
  F share;
  Vec3Lanes<F> normal;  // unit, to its inside
};

// What a vector of points sees of a parallelogram in a cell.
template <class F>
struct PlaneSeen {
  F share;            // of the cell's part above the points' horizon
  CellCut<F> cut[4];  // by the edges
  // Where light comes back:
  F distance;  // along the cell's direction
  F reach;     // along the direction, to where another hides it
  F front;     // of the share, the part that nothing hides
  F visible;   // share that other parallelograms leave
  const PlaneLines* lines;
};

template <class F>
FT_HD_INLINE void find_cuts(const CellTask& task, const Vec3Lanes<F>& p, PlaneSeen<F>& plane) {
  const PlaneLines& lines = *plane.lines;
  const F height = height_over<F>(lines, p), fall = nearing<F>(lines.centre, height);
  EdgeCut<F> x[2], y[2];
  cut_by_edges<F>(lines.x, lines.centre.dx, lines.per_unit_x, height, fall, task.cosine_half, p, x);
  cut_by_edges<F>(lines.y, lines.centre.dy, lines.per_unit_y, height, fall, task.cosine_half, p, y);
  const auto add = [&](const EdgeCut<F>& edge, const float* row, CellCut<F>& cut) {
    const auto component = [&](int a) {
      return edge.of_height * splat<F>(lines.height[a]) + edge.of_row * splat<F>(row[a]);
    };
    cut = {edge.share, {component(0), component(1), component(2)}};
  };
  for (int k = 0; k < 2; ++k) {
    add(x[k], lines.x, plane.cut[k]);
    add(y[k], lines.y, plane.cut[2 + k]);
  }
}

// The share of a cell that lies within two sets of half-spaces.
template <class F>
FT_HD_INLINE F overlap(const CellCut<F>* a, int a_count, F a_share, const CellCut<F>* b, int b_count, F b_share) {
  F least = splat<F>(1.0f), most = least;
  for (int i = 0; i < a_count; ++i) {
    for (int j = 0; j < b_count; ++j) {
      const F relative = relative_overlap<F>(a[i].share, b[j].share, dot(a[i].normal, b[j].normal));
      least = min(least, relative), most = max(most, relative);
    }
  }
  return min(a_share * b_share * (least * most), min(a_share, b_share));
}

// The parallelograms in a cell. Those that share an edge, as the walls of a room do, hide the cell between them, and
// one that stands on the points' horizon hides all above it; so shares are joined by how the planes through the points
// and the edges that cut them lie to each other.
template <class F>
class PlanesSeen {
 public:
  FT_HD_INLINE PlanesSeen(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& s)
      : PlanesSeen(task, p, s, [](const PlaneLines&, F share) { return share; }) {}

  // limit(plane, share): the part of a share that counts.
  template <class Limit>
  FT_HD_INLINE PlanesSeen(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& s, const Limit& limit) {
    const F half = splat<F>(0.5f);
    for (int k = 0; k < task.plane_count; ++k) {
      const PlaneLines& lines = task.planes[k];
      F share = limit(lines, share_of_slope<F>(lines, lines.centre, task.cosine_half, p));
      if (lines.one_sided) {
        share = select(affine<F>(lines.height, p) < splat<F>(lines.least_height), zero_, share);
      }
      if (!any(share > zero_)) continue;
      if (count_ == k_most_planes) {
        clear_ = clear_ * (one_ - share);
        continue;
      }
      PlaneSeen<F>& plane = planes_[count_++];
      plane.lines = &task.planes[k];
      plane.share = share;
      if (!task.reflects) continue;
      const F height = height_over<F>(lines, p), fall = nearing<F>(lines.centre, height);
      plane.distance = select(fall > zero_, abs(height) / max(fall, splat<F>(1e-20f)), splat<F>(1e30f));
      plane.front = one_, plane.reach = plane.distance;
    }
    if (count_ == 0) return;
    const F above = dot3<F>(task.vector, s) * splat<F>(0.5f / task.cosine_half);
    const F below = min(max(half - above, zero_), one_);
    if (count_ == 1 && !any(below > zero_)) {
      clear_ = clear_ * (one_ - planes_[0].share);
      return;
    }
    const F lit = select(below < one_, one_ - below, one_);
    const CellCut<F> dark = {below, {zero_ - s.x, zero_ - s.y, zero_ - s.z}};
    F hidden = zero_;
    for (int k = 0; k < count_; ++k) {
      PlaneSeen<F>& plane = planes_[k];
      find_cuts<F>(task, p, plane);
      if (any(below > zero_)) {
        const F both = overlap<F>(plane.cut, 4, plane.share, &dark, 1, below);
        plane.share = select((below > zero_) & (below < one_), min((plane.share - both) / lit, one_), plane.share);
      }
      F added = plane.share;
      for (int i = 0; i < k; ++i) {
        PlaneSeen<F>& other = planes_[i];
        const F both = overlap<F>(plane.cut, 4, plane.share, other.cut, 4, other.share);
        const F left = one_ - both / max(plane.share, splat<F>(1e-12f));
        added = added * left;
        if (!task.reflects) continue;
        const F left_of_other = one_ - both / max(other.share, splat<F>(1e-12f));
        const Mask_t<F> behind = other.distance < plane.distance;
        plane.front = plane.front * select(behind, left, one_);
        other.front = other.front * select(behind, one_, left_of_other);
      }
      hidden = min(hidden + added, one_);
    }
    clear_ = clear_ * (one_ - hidden);
  }

  FT_HD_INLINE F clear() const { return clear_; }  // share of the cell's part above the horizon

 protected:
  const F zero_ = splat<F>(0.0f), one_ = splat<F>(1.0f);
  PlaneSeen<F> planes_[k_most_planes];
  int count_ = 0;
  F clear_ = one_;
};

// What objects send back along a cell, front to back. Maps are met in the order of their places; whether a plane lies
// before a map's object is told by where the cell's direction meets it and by the object's centre.
template <class F>
class CellLight : PlanesSeen<F> {
  using PlanesSeen<F>::planes_, PlanesSeen<F>::count_, PlanesSeen<F>::zero_, PlanesSeen<F>::one_;

 public:
  using PlanesSeen<F>::clear;

  FT_HD_INLINE CellLight(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& s)
      : PlanesSeen<F>(task, p, s), task_(task) {
    for (int k = 0; k < count_; ++k) {
      const PlaneLines& lines = *planes_[k].lines;
      const F distance = planes_[k].distance;
      const F x = affine<F>(lines.x, p) + splat<F>(lines.centre.dx) * distance;
      const F y = affine<F>(lines.y, p) + splat<F>(lines.centre.dy) * distance;
      const Mask_t<F> met = (abs(x) <= one_) & (abs(y) <= one_) & (planes_[k].share > zero_);
      for (int i = 0; i < count_; ++i) {
        PlaneSeen<F>& other = planes_[i];
        other.reach = select(met & (distance < other.distance), min(other.reach, distance * splat<F>(1.0f - task.half)),
                             other.reach);
      }
    }
    // Two that adjoin hide all of a third, not the product of what each leaves of it.
    for (int k = 0; k < count_; ++k) planes_[k].visible = planes_[k].share * planes_[k].front;
    for (int k = 0; k < count_; ++k) {
      PlaneSeen<F>& plane = planes_[k];
      plane.front = min(plane.front, left_before(plane.distance) / max(plane.share, splat<F>(1e-12f)));
    }
  }

  // share: what sends light back, of what is hidden.
  FT_HD_INLINE void add_own(F share, F hidden, const Vec3Lanes<F>& p) {
    const Mask_t<F> wanted = share > zero_;
    if (task_.own_radiance && task_.own_radiance->view && any(wanted)) {
      const F z = affine<F>(task_.own->lines.z, p);
      // The points lie within the ball, whatever rounding says.
      add(radiance_of_map<F>(*task_.own_radiance, p, max(z, splat<F>(-1.0f)), wanted), share);
    }
    front_ = one_ - hidden;
  }

  // Where what lies behind the objects met so far still matters.
  FT_HD_INLINE Mask_t<F> open() const { return front_ > splat<F>(k_hidden_rounding); }

  // Returns where an undecided answer of the map matters.
  FT_HD_INLINE Mask_t<F> add_map(int k, const MapShare<F>& share, const Vec3Lanes<F>& p) {
    const MapRadiance& map = task_.map_radiance[k];
    const Mask_t<F> reached = open(), wanted = (share.hidden > zero_) & reached;
    if (!any(wanted | share.near)) return wanted & share.near;
    const F distance = splat<F>(map.place) - dot3<F>(task_.direction, p);
    const F leaves = select(wanted, one_ - share.hidden, one_);
    const F before = front_ * left_before(distance);
    for (int i = 0; i < count_; ++i) {
      PlaneSeen<F>& plane = planes_[i];
      plane.front = plane.front * select(plane.distance < distance, one_, leaves);
    }
    front_ = front_ * leaves;
    if (map.view && any(wanted)) {
      add(radiance_of_map<F>(map, p, affine<F>(task_.maps[k].z, p), wanted),
          select(wanted, before * share.hidden, zero_));
    }
    return share.near & (before > splat<F>(k_hidden_rounding));
  }

  // Of `own_share` hidden by the points' own object, which lies before all planes.
  FT_HD_INLINE Vec3Lanes<F> finish(F own_share, const Vec3Lanes<F>& p) {
    for (int i = 0; i < count_; ++i) {
      const PlaneSeen<F>& plane = planes_[i];
      if (!plane.lines->radiance) continue;
      const PlaneLines& lines = *plane.lines;
      const F left = plane.front * (one_ - own_share), seen = plane.share * left;
      const Mask_t<F> wanted = seen > splat<F>(k_hidden_rounding);
      if (!any(wanted)) continue;
      const F height = height_over<F>(lines, p);
      RadianceRange<F> range;
      const Vec3Lanes<F> light =
          radiance_of_plane<F>(*lines.radiance, lines.centre, affine<F>(lines.x, p), affine<F>(lines.y, p), height,
                               nearing<F>(lines.centre, height), 2.0f * task_.half, plane.reach, wanted, range);
      add(light, select(wanted, seen, zero_));
      undecided_ = undecided_ | (wanted & range.is_uneven(k_most_uneven) & (left > splat<F>(k_hidden_rounding)) &
                                 (left < splat<F>(1.0f - k_hidden_rounding)));
    }
    return light_;
  }

  // Once finished.
  FT_HD_INLINE Mask_t<F> undecided() const { return undecided_; }

 private:
  FT_HD_INLINE void add(const Vec3Lanes<F>& radiance, F share) { light_ = light_ + radiance * share; }

  // What parallelograms nearer than that leave.
  FT_HD_INLINE F left_before(F distance) const {
    F left = one_;
    for (int i = 0; i < count_; ++i) {
      left = left - select(planes_[i].distance < distance, planes_[i].visible, zero_);
    }
    return max(left, zero_);
  }

  const CellTask& task_;
  F front_ = one_;  // what objects met so far leave clear
  Mask_t<F> undecided_ = one_ < zero_;
  Vec3Lanes<F> light_ = {zero_, zero_, zero_};
};

// What a vector of points sees of a cell.
template <class F>
struct CellSeen {
  F clear;                  // share that nothing hides
  Mask_t<F> near;           // undecided
  Vec3Lanes<F> light = {};  // radiance that comes back, mean over the cell

  FT_HD_INLINE void hide(const MapShare<F>& share) {
    clear = select(share.near, clear, clear * (splat<F>(1.0f) - share.hidden));
    near = near | share.near;
  }
  FT_HD_INLINE bool is_open() const { return any(clear > splat<F>(k_hidden_rounding)); }

  // Once all maps are read. reached: where balls matter.
  FT_HD_INLINE void finish(const CellTask& task, const Vec3Lanes<F>& p, Mask_t<F> reached) {
    for (int k = 0; k < task.ball_count; ++k) near = near | (reached & may_meet<F>(task.balls[k], task, p));
    // Whatever other lanes went on for.
    clear = select(clear > splat<F>(k_hidden_rounding), clear, splat<F>(0.0f));
  }
};

// Of the light that a cell sends to the shading normals `s` at the cosine `cosine`, the share from above the surface.
template <class F>
FT_HD_INLINE F above_surface(const CellTask& task, const Vec3Lanes<F>& g, const Vec3Lanes<F>& s, F cosine) {
  const F one = splat<F>(1.0f), at = dot3<F>(task.vector, g);
  const Mask_t<F> cut = at < splat<F>(task.cosine_half);
  if (!any(cut)) return one;
  return select(cut, share_above<F>(cosine, dot3<F>(task.vector, s), at, dot(g, s), task.cosine_half), one);
}

template <class F>
FT_HD_INLINE MapShare<F> nothing_hidden() {
  const F zero = splat<F>(0.0f);
  return {zero, zero > splat<F>(1.0f)};
}

// The share of the point's own object, of a cell of which the part `above` comes from above its surface.
template <class F>
FT_HD_INLINE MapShare<F> with_surface(const MapShare<F>& share, F above) {
  const F one = splat<F>(1.0f);
  return {one - (one - share.hidden) * above, and_not(above <= splat<F>(0.0f), share.near)};
}

// How far points turn from a cell's direction, to the middle of what their cosine leaves of its light.
template <class F>
FT_HD_INLINE Vec3Lanes<F> lean_of(const CellTask& task, const Vec3Lanes<F>& s) {
  return s * cosine_shift<F>(dot3<F>(task.vector, s), splat<F>(task.cosine_half));
}

// Where nothing sends light back. own(), map(lines, lean): shares of the points' own object and of others; planes():
// what parallelograms leave.
template <class F, class Own, class Map, class Planes>
FT_HD_INLINE CellSeen<F> look_at_objects(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                         const Vec3Lanes<F>& s, F cosine, const Own& own, const Map& map,
                                         const Planes& planes) {
  const Mask_t<F> lit = cosine > splat<F>(0.0f);
  CellSeen<F> seen = {splat<F>(task.clear), and_not(lit, lit)};
  if (task.own) {
    seen.hide(with_surface<F>(own(), above_surface<F>(task, g, s, cosine)));
  } else if (task.bent) {
    seen.hide(with_surface<F>(nothing_hidden<F>(), above_surface<F>(task, g, s, cosine)));
  }
  if (task.plane_count > 0 && seen.is_open()) seen.clear = seen.clear * planes();
  if (task.map_count > 0) {
    const Vec3Lanes<F> lean = lean_of<F>(task, s);
    for (int k = 0; k < task.map_count && seen.is_open(); ++k) seen.hide(map(task.maps[k], lean));
  }
  seen.finish(task, p, lit);
  return seen;
}

template <class F, class Own>
FT_HD_INLINE CellSeen<F> look_at_reflecting_cell(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                                 const Vec3Lanes<F>& s, F cosine, const Own& own) {
  const Mask_t<F> lit = cosine > splat<F>(0.0f);
  CellLight<F> light(task, p, s);
  CellSeen<F> seen = {light.clear(), and_not(lit, lit)};
  F own_share = splat<F>(0.0f);
  if (task.own || task.bent) {
    const MapShare<F> share = task.own ? own() : nothing_hidden<F>();
    const F above = above_surface<F>(task, g, s, cosine);
    const MapShare<F> hidden = with_surface<F>(share, above);
    own_share = hidden.hidden;
    seen.hide(hidden);
    light.add_own(share.hidden * above, own_share, p);
  }
  const Vec3Lanes<F> lean = lean_of<F>(task, s);
  for (int k = 0; k < task.map_count && any(light.open()); ++k) {
    const MapShare<F> share = share_of_map<F>(task.maps[k], p, lean);
    seen.hide({share.hidden, light.add_map(k, share, p)});
  }
  seen.light = light.finish(own_share, p);
  seen.finish(task, p, light.open());
  seen.near = seen.near | light.undecided();
  return seen;
}

template <class F, class Own>
FT_HD_INLINE CellSeen<F> look_at_cell(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                      const Vec3Lanes<F>& s, F cosine, const Own& own) {
  if (task.reflects) return look_at_reflecting_cell<F>(task, p, g, s, cosine, own);
  return look_at_objects<F>(
      task, p, g, s, cosine, own,
      [&](const MapLines& lines, const Vec3Lanes<F>& lean) { return share_of_map<F>(lines, p, lean); },
      [&] { return PlanesSeen<F>(task, p, s).clear(); });
}

// What a cell adds to the sums of points.
template <class F>
struct CellTaken {
  Vec3Lanes<F> irradiance;  // hidden or undecided
  Vec3Lanes<F> reflected;   // 0 unless the task reflects
  Mask_t<F> open;           // undecided
};

// What was seen, of points whose shading normals see the cell at `cosine`.
template <class F>
FT_HD_INLINE CellTaken<F> taken_of(const CellTask& task, float grazing, const CellSeen<F>& seen, F cosine) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const Mask_t<F> lit = cosine > zero;
  if (grazing > 0.0f) cosine = weight_of_cosine<F>(cosine, grazing);
  // Nothing of what is undecided counts; where an object sends light back, hidden cells may be undecided, too.
  const Mask_t<F> open = task.reflects ? seen.near & lit : seen.near & lit & (seen.clear > zero);
  const F taken = select(open, one, one - seen.clear) * cosine;
  const F arriving = select(open, zero, cosine) * splat<F>(4.0f * task.half * task.half);
  return {{taken * splat<F>(task.weight[0]), taken * splat<F>(task.weight[1]), taken * splat<F>(task.weight[2])},
          {seen.light.x * arriving, seen.light.y * arriving, seen.light.z * arriving},
          open};
}

// cosine: cosine_over_cell() of the shading normals s.
template <class F>
FT_HD_INLINE CellTaken<F> take_cell(const CellTask& task, float grazing, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                    const Vec3Lanes<F>& s, F cosine) {
  const auto own = [&] { return share_of_own<F>(*task.own, p, g); };
  return taken_of<F>(task, grazing, look_at_cell<F>(task, p, g, s, cosine, own), cosine);
}

// The cosine of the cell for shading normals s.
template <class F>
FT_HD_INLINE F cosine_of(const CellTask& task, const Vec3Lanes<F>& s) {
  return cosine_over_cell<F>(dot3<F>(task.vector, s), splat<F>(task.cosine_half));
}

// Adds what the cell's hidden and undecided parts take from the points' irradiance, and what comes back from them.
// Lists the points for which it is undecided in `undecided`, which has room for all and a vector more, and returns
// their number. Look: as LookAtCell.
template <class F, class Look>
FT_HD_INLINE int see_cell_by(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  constexpr int k_count = Lanes<F>::k_count;
  int listed = 0;
  for (int32_t i = 0; i < points.size; i += k_count) {
    const Vec3Lanes<F> s = {load_lanes<F>(points.sx + i), load_lanes<F>(points.sy + i), load_lanes<F>(points.sz + i)};
    const F cosine = cosine_of<F>(task, s);
    if (!any(cosine > splat<F>(0.0f))) continue;
    const Vec3Lanes<F> p = {load_lanes<F>(points.px + i), load_lanes<F>(points.py + i), load_lanes<F>(points.pz + i)};
    const Vec3Lanes<F> g = {load_lanes<F>(points.gx + i), load_lanes<F>(points.gy + i), load_lanes<F>(points.gz + i)};
    const CellTaken<F> taken = taken_of<F>(task, points.grazing, Look::look(task, p, g, s, cosine, i), cosine);
    const auto add = [&](float* sum, F value) { store_lanes(load_lanes<F>(sum + i) + value, sum + i); };
    add(sums.red, taken.irradiance.x), add(sums.green, taken.irradiance.y), add(sums.blue, taken.irradiance.z);
    if (task.reflects) {
      add(sums.reflected_red, taken.reflected.x), add(sums.reflected_green, taken.reflected.y);
      add(sums.reflected_blue, taken.reflected.z);
    }
    if (any(taken.open)) listed += compress_store(lane_sequence<F>(i), taken.open, undecided + listed);
  }
  return listed;
}

// What see_own() kept of the points from `i` on.
template <class F>
FT_HD_INLINE MapShare<F> kept_share(const OwnShares& kept, int32_t i) {
  return {load_lanes<F>(kept.hidden + i), load_lanes<F>(kept.near + i) > splat<F>(0.0f)};
}

template <class F>
struct LookAtCell {
  static FT_HD_INLINE CellSeen<F> look(const CellTask& task, const Vec3Lanes<F>& p, const Vec3Lanes<F>& g,
                                       const Vec3Lanes<F>& s, F cosine, int32_t i) {
    return look_at_cell<F>(task, p, g, s, cosine, [&] {
      return task.own_shares ? kept_share<F>(*task.own_shares, i) : share_of_own<F>(*task.own, p, g);
    });
  }
};

// What the points' own object hides of a cell, for cells that read the same of it.
template <class F>
FT_HD_INLINE void see_own(const OwnLines& own, const CellPoints& points, const OwnShares& kept) {
  for (int32_t i = 0; i < points.size; i += Lanes<F>::k_count) {
    const Vec3Lanes<F> p = {load_lanes<F>(points.px + i), load_lanes<F>(points.py + i), load_lanes<F>(points.pz + i)};
    const Vec3Lanes<F> g = {load_lanes<F>(points.gx + i), load_lanes<F>(points.gy + i), load_lanes<F>(points.gz + i)};
    const MapShare<F> share = share_of_own<F>(own, p, g);
    store_lanes(share.hidden, kept.hidden + i);
    store_lanes(select(share.near, splat<F>(1.0f), splat<F>(0.0f)), kept.near + i);
  }
}

template <class F>
FT_HD_INLINE int see_cell(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  return see_cell_by<F, LookAtCell<F>>(task, points, sums, undecided);
}

FT_LANES_END

#endif  // toggled guard
