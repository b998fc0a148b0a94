// A small part of a light as seen from a point (a stratum): the share of its rays that an object leaves clear, filtered
// from the coverage maps. A light is many strata, so that it needs no rays where it is partly hidden.
//
// All rays of a stratum lie in a thin tube about its centre ray. Seen along the direction c of the ray's direction
// cell, the tube is a disc at the depth of whatever hides it: the share of lines in the disc that hit is the share of
// the stratum that is hidden. The depth comes from the coverage map itself: first the mean depth of all that the tube
// can meet, then that of what lies in the disc placed there; the disc is placed once more, and summed to fractions of
// texels. (Percentage-closer soft shadows, Fernando, SIGGRAPH 2005 sketches, search for the blocker's depth likewise,
// in one depth map for a whole light.) Strata that the maps do not resolve are refused: discs smaller than about a
// texel, several layers of blockers, features as thin as texels.
//
// Where the way from world to unit space does not keep angles, the disc is the ellipse that a disc of the world becomes
// in the map (the footprint of Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989, section 3.3), and
// what is summed are rectangles along the map's axes in a row along it.
//
// Space: unit space of the object (field/chart/chart.hd.h). Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_STRATUM_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_STRATUM_HD_H_
#undef FIELDTRACE_FIELD_QUERY_STRATUM_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_STRATUM_HD_H_
#endif

#include "field/query/cone.hd.h"

FT_LANES_BEGIN

// One stratum: its centre ray, of unit direction, and the half width of its tube per unit of distance from the ray's
// origin (if the tube is not round, a bound on it).
template <class F>
struct LightStratum {
  Vec3Lanes<F> p, direction;  // p: the ray's origin, or another point of the ray
  F width;
  F offset;      // distance from the ray's origin to p
  F near;        // half width of the shading points about the ray's origin; for tubes that are not round in world space
  F near_bound;  // bound on it in unit space
  F length;      // distance from the ray's origin to the light
  // Tubes that are not round, for instances that do not keep angles:
  const float* to_unit;  // world -> unit space, 3 x 4, column-major; null: the tube is round
  F world_width;         // half width per unit of distance, in world space
  F world_unit;          // unit distance along the ray, in world space
  F bend;                // bound on the relative difference of the rays' lengths to a depth

  FT_HD_INLINE Vec3Lanes<F> at(F t) const { return p + direction * (t - offset); }
};

template <class F>
FT_HD_INLINE LightStratum<F> round_stratum(const Vec3Lanes<F>& p, const Vec3Lanes<F>& direction, F width) {
  const F zero = splat<F>(0.0f);
  return {p, direction, width, zero, zero, zero, splat<F>(1.0f), nullptr, zero, zero, zero};
}

// Half widths of a stratum's tube along a map's axes: the light's per unit of distance, and those of the shading
// points; and the correlation of offsets along the two axes.
template <class F>
struct TubeWidths {
  F x, y;
  F near_x, near_y;
  F correlation;
};

// Half width of the disc that the rays of a stratum from all of its shading points fill at a distance t: the variances
// of both ends add.
template <class F>
FT_HD_INLINE F half_width(const LightStratum<F>& stratum, F width, F near, F t) {
  const F from_light = width * t, from_points = near * (splat<F>(1.0f) - t / stratum.length);
  return sqrt(from_light * from_light + from_points * from_points);
}

template <class F>
struct StratumAnswer {
  F clear;  // share of the stratum, [0, 1]
  Mask_t<F> unknown, refused;
  Int_t<F> lookups;
};

// Limit on how far the stratum's rays diverge from the map's lines between the depths in a disc (means of its halves:
// depth_difference()), in half widths of the disc. Beyond it one surface may hide another from the lines where the rays
// pass between the two.
constexpr float k_most_apart = 1.0f;
// A stratum's errors are a sixteenth of the light's (k_strata of hybrid/light/group_light.h) and differ from those of
// others. What the width of the shading points lends to its disc is the same in all of them, and counts as its root.
constexpr float k_near_share = 0.25f;
// Strata seen from shading points farther apart than this (half width, in texels) are refused: what hides the light
// from some of them differs from what hides it from others (docs/decisions/023-clusters.md).
constexpr float k_widest_near = 2.0f;
// Rays of one stratum differ in length to a depth by no more than this share: the tube's width is right to first order.
constexpr float k_most_bend = 0.25f;
// Tiles with a larger thin-feature ratio than this (field/store/coverage.hd.h) need discs of the half width below, in
// texels.
constexpr float k_most_thin_features = 0.15f;
constexpr float k_coarse_disc = 4.0f;

// Rectangles along a disc that is aslant to the map's axes.
constexpr int k_aslant_rects = 4;

// Which coverage map of an object is read along a ray: as the ray's end sees it, or as its origin does. The same lines
// meet the object in both, but at different surfaces first, and so at different depths.
enum class SeenFrom { end, origin };

// A stratum's tube in the coverage map of its direction cell, and all that it can meet there.
template <class F>
struct StratumTube {
  ConeSpan<F> span;
  CoverageMap<F> map;
  F cosine, slope;  // cosine and sine of the angle between the stratum's ray and the cell's direction
  float sign;       // of the cosine
  F middle_depth;   // of the span's middle
  TubeWidths<F> widths;
  MapSquare<F> square;
  CoverageSum<F> sum;

  // Distance from the ray's origin at which the centre ray reaches the mean depth of `count` lines; `depths`: the sum
  // of their codes.
  FT_HD_INLINE F reach_of(F depths, F count) const {
    const F depth = splat<F>(k_coverage_depth_step) * (depths / max(count, splat<F>(1e-6f))) - splat<F>(1.0f);
    const F along = (depth - middle_depth) * splat<F>(sign);
    const F t = span.middle + along / max(cosine * splat<F>(sign), splat<F>(0.5f));
    return min(max(t, span.middle - span.half), span.middle + span.half);
  }
};

// How much wider the tube of a stratum that bends no more than it may can be at a depth than its width says.
template <class F>
FT_HD_INLINE F most_stretched(const LightStratum<F>& stratum) {
  const F one = splat<F>(1.0f);
  return one / max(one - stratum.bend, splat<F>(1.0f - k_most_bend));
}

template <class F>
FT_HD_INLINE ConeSpan<F> span_of_stratum(const LightStratum<F>& stratum) {
  LightCone<F> tube;
  tube.p = stratum.p;
  tube.axis = stratum.direction;
  tube.tangent = stratum.width;
  if (stratum.to_unit) tube.tangent = tube.tangent * most_stretched(stratum);
  tube.near = stratum.near_bound;
  return span_in_ball(tube, stratum.offset);
}

// An offset in the map is that across the ray, moved along the ray to the depth of the ray's point: the linear map of
// offsets across the world's ray has the rows A^T u, with A = to_unit's linear part and u = s - c (s.d) / (c.d).
template <class F>
FT_HD_INLINE TubeWidths<F> widths_in_map(const LightStratum<F>& stratum, const CoverageMap<F>& map) {
  const F near = stratum.near;
  if (!stratum.to_unit) return {stratum.width, stratum.width, near, near, splat<F>(0.0f)};
  const F inverse_cosine = splat<F>(1.0f) / dot(stratum.direction, map.frame.c);
  const auto row = [&](const Vec3Lanes<F>& axis) {
    return transposed_vector(stratum.to_unit, axis - map.frame.c * (dot(stratum.direction, axis) * inverse_cosine));
  };
  const Vec3Lanes<F> x = row(map.frame.s), y = row(map.frame.t);
  const F extent_x = sqrt(dot(x, x)), extent_y = sqrt(dot(y, y)), scale = stratum.world_width * stratum.world_unit;
  return {scale * extent_x, scale * extent_y, near * extent_x, near * extent_y,
          dot(x, y) / max(extent_x * extent_y, splat<F>(1e-30f))};
}

template <class F, class TellMissing>
FT_HD_INLINE StratumTube<F> tube_of_stratum(const FieldView& field, SeenFrom seen, const LightStratum<F>& stratum,
                                            const ConeSpan<F>& span, Mask_t<F> queried,
                                            const TellMissing& tell_missing) {
  StratumTube<F> tube;
  tube.span = span;
  tube.sign = seen == SeenFrom::end ? 1.0f : -1.0f;
  tube.map = map_along(field, stratum.direction * splat<F>(tube.sign));
  tube.widths = widths_in_map(stratum, tube.map);
  const Vec3Lanes<F> middle = stratum.at(span.middle);
  tube.cosine = dot(stratum.direction, tube.map.frame.c);
  const Vec3Lanes<F> across = stratum.direction - tube.map.frame.c * tube.cosine;
  tube.slope = sqrt(dot(across, across));
  tube.middle_depth = dot(middle, tube.map.frame.c);
  F end = span.middle + span.half;
  if (stratum.to_unit) end = end * most_stretched(stratum);
  const F aside = span.half * tube.slope;
  tube.square = rectangle_about(tube.map, middle, end * tube.widths.x + tube.widths.near_x + aside,
                                end * tube.widths.y + tube.widths.near_y + aside);
  tube.sum = sum_coverage<F>(field.coverage, tube.map.direction, tube.square.rect, queried, tell_missing);
  return tube;
}

// The disc of a stratum where its tube meets something, placed twice.
template <class F>
struct StratumDisc {
  F t;                // distance from the ray's origin
  F half_x, half_y;   // half widths in texels
  F x, y;             // in texels
  PlaneRect<F> rect;  // of the map
  Mask_t<F> read;     // it meets something, and the rectangle is not empty
  Mask_t<F> unknown;

  FT_HD_INLINE F least_half() const { return min(half_x, half_y); }
};

// The rectangle within (x +- half_x, y +- half_y), in texels, clipped to the map, [0, L]^2.
template <class F>
FT_HD_INLINE PlaneRect<F> clipped_rect(const FieldView& field, F x, F y, F half_x, F half_y) {
  const F zero = splat<F>(0.0f), lines = splat<F>(2.0f * field.coverage.half_lines);
  const auto within = [&](F value) { return min(max(zero, value), lines); };
  return {within(x - half_x), within(x + half_x), within(y - half_y), within(y + half_y)};
}

// Where a rectangle is not empty.
template <class F>
FT_HD_INLINE Mask_t<F> has_area(const PlaneRect<F>& rect) {
  return (rect.x0 < rect.x1) & (rect.y0 < rect.y1);
}

// Whether lines as thin as texels abound about a disc's centre.
template <class F>
FT_HD_INLINE Mask_t<F> is_among_thin_features(const FieldView& field, const StratumTube<F>& tube,
                                              const StratumDisc<F>& disc, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), scale = splat<F>(field.coverage.half_lines);
  const auto texel = [&](F value) { return small_to_int(min(max(zero, floor(value)), scale + scale - one)); };
  return thin_feature_ratio_at<F>(field.coverage, tube.map.direction, texel(disc.x), texel(disc.y), wanted) >
         splat<F>(k_most_thin_features);
}

template <class F, class TellMissing>
FT_HD_INLINE StratumDisc<F> place_disc(const FieldView& field, const LightStratum<F>& stratum,
                                       const StratumTube<F>& tube, Mask_t<F> open, const TellMissing& tell_missing) {
  const F half = splat<F>(0.5f);
  const CoverageMap<F>& map = tube.map;
  const F scale = splat<F>(field.coverage.half_lines);
  const TubeWidths<F>& widths = tube.widths;
  const auto x_at = [&](F t) { return max(half_width(stratum, widths.x, widths.near_x, t) * scale, half) / scale; };
  const auto y_at = [&](F t) { return max(half_width(stratum, widths.y, widths.near_y, t) * scale, half) / scale; };
  const F first = tube.reach_of(to_float(tube.sum.depths), to_float(tube.sum.count));
  const MapSquare<F> found = rectangle_about(map, stratum.at(first), x_at(first), y_at(first));
  const CoverageSum<F> near = sum_coverage<F>(field.coverage, map.direction, found.rect, open, tell_missing);
  // A sum that lacks a tile would misplace the disc, and demand other tiles than the complete sum does.
  const Mask_t<F> hit = and_not(near.unknown, open & (near.count > splat_int<F>(0)));
  StratumDisc<F> disc;
  disc.t = select(hit, tube.reach_of(to_float(near.depths), to_float(near.count)), first);
  disc.half_x = x_at(disc.t) * scale;
  disc.half_y = y_at(disc.t) * scale;
  const Vec3Lanes<F> centre = stratum.at(disc.t);
  disc.x = map.texels(centre, map.frame.s);
  disc.y = map.texels(centre, map.frame.t);
  disc.rect = clipped_rect<F>(field, disc.x, disc.y, disc.half_x, disc.half_y);
  disc.read = hit & has_area(disc.rect);
  disc.unknown = near.unknown;
  return disc;
}

// What a disc to read is summed over: rectangles of one size, one by one. Discs that are aslant to the map's axes are a
// row of them along the disc, which have its variances and nearly its covariance (15/16 of it, of four).
template <class F>
struct DiscRects {
  const FieldView& field;
  const StratumDisc<F>& disc;
  int count;
  F x, y;      // from the disc's middle to the row's end
  F w, h;      // half widths of each
  F per_area;  // 1 / the area of all

  FT_HD_INLINE DiscRects(const FieldView& f, const LightStratum<F>& stratum, const StratumTube<F>& tube,
                         const StratumDisc<F>& d)
      : field(f), disc(d), count(stratum.to_unit ? k_aslant_rects : 1) {
    const F one = splat<F>(1.0f), half = splat<F>(0.5f);
    const F aslant = min(abs(tube.widths.correlation), one), length = sqrt(aslant);
    const float part = 1.0f / float(count);
    // The row spreads evenly over `length`, and what is left goes across.
    const F within = sqrt(one - aslant * splat<F>(1.0f - part * part));
    x = disc.half_x * length, y = disc.half_y * copysign(length, tube.widths.correlation);
    w = max(disc.half_x * within, half), h = max(disc.half_y * within, half);
    per_area = splat<F>(0.25f * part) / (w * h);
  }
  FT_HD_INLINE PlaneRect<F> rect(int i) const {
    const F at = splat<F>(float(2 * i + 1) / float(count) - 1.0f);
    return clipped_rect<F>(field, disc.x + x * at, disc.y + y * at, w, h);
  }
};

// Lines of a disc that hit, over all of its rectangles.
template <class F, class TellMissing>
FT_HD_INLINE CoverageArea<F> sum_disc(const StratumTube<F>& tube, const DiscRects<F>& rects,
                                      const TellMissing& tell_missing) {
  CoverageArea<F> sum = {splat<F>(0.0f), rects.disc.unknown};
  for (int i = 0; i < rects.count; ++i) {
    const PlaneRect<F> rect = rects.rect(i);
    const CoverageArea<F> area = sum_coverage_area<F>(rects.field.coverage, tube.map.direction, rect,
                                                      rects.disc.read & has_area(rect), tell_missing);
    sum.count = sum.count + area.count;
    sum.unknown = sum.unknown | area.unknown;
  }
  return sum;
}

// How far the stratum's rays diverge from the map's lines between the depths in a disc, in texels.
template <class F>
FT_HD_INLINE F depths_apart(const FieldView& field, const StratumTube<F>& tube, const StratumDisc<F>& disc,
                            Mask_t<F> wanted) {
  const CoverageView& view = field.coverage;
  const TexelRect<F> rect = texels_about<F>(view, disc.rect);
  const CoverageSum<F> all = sum_coverage<F>(view, tube.map.direction, rect, wanted, [](Int_t<F>, Mask_t<F>) {});
  const F rise = depth_difference<F>(view, tube.map.direction, rect, all, wanted);
  const F width = max(tube.widths.x, tube.widths.y);
  return rise * (tube.slope + width) * splat<F>(view.half_lines);
}

// The object lies in front of the shading point, which is outside the ball, or inside it with the whole object in front
// of its tangent plane. least_disc: half width in texels below which discs are refused. All limits on estimated errors
// are widened by the policy's slack. length: distance from the ray's origin to the light along the stratum's rays.
template <class F, class TellMissing>
FT_HD_INLINE StratumAnswer<F> filter_stratum(const FieldView& field, const QueryPolicy& policy, float least_disc,
                                             const LightStratum<F>& stratum, F length, Mask_t<F> wanted,
                                             const TellMissing& tell_missing) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const ConeSpan<F> span = span_of_stratum(stratum);
  StratumAnswer<F> answer;
  answer.clear = one;
  answer.unknown = and_not(wanted, wanted);
  // Where the light lies within the ball, segments end before their lines do.
  const F least_length = length * (one - stratum.bend);
  answer.refused = wanted & (span.half > zero) & (span.middle + span.half > least_length);
  const F widest = stratum.near_bound * splat<F>(field.coverage.half_lines);
  answer.refused = answer.refused | (wanted & (widest > splat<F>(k_widest_near * policy.slack)));
  if (stratum.to_unit) answer.refused = answer.refused | (wanted & (stratum.bend > splat<F>(k_most_bend)));
  const Mask_t<F> queried = and_not(answer.refused, wanted & (span.half > zero));
  answer.lookups = select(queried, splat_int<F>(1), splat_int<F>(0));
  if (!any(queried)) return answer;

  const StratumTube<F> tube = tube_of_stratum<F>(field, SeenFrom::end, stratum, span, queried, tell_missing);
  answer.unknown = tube.sum.unknown;
  const TexelRect<F>& all = tube.square.rect;
  const Int_t<F> texels = (all.x1 - all.x0) * (all.y1 - all.y0);
  const Mask_t<F> blocked = queried & tube.square.whole & (tube.sum.count == texels);
  answer.clear = select(blocked, zero, one);
  const Mask_t<F> open = and_not(answer.unknown | blocked | (tube.sum.count == splat_int<F>(0)), queried);
  if (!any(open)) return answer;

  const StratumDisc<F> disc = place_disc<F>(field, stratum, tube, open, tell_missing);
  const DiscRects<F> rects(field, stratum, tube, disc);
  const CoverageArea<F> area = sum_disc<F>(tube, rects, tell_missing);
  answer.lookups = answer.lookups + select(open, splat_int<F>(1), splat_int<F>(0)) +
                   select(disc.read, splat_int<F>(1), splat_int<F>(0));
  answer.unknown = answer.unknown | area.unknown;
  // Float sums: within a few roundings of 0 or 1 the disc counts as empty or full.
  const F hidden = area.count * rects.per_area;
  const Mask_t<F> some = disc.read & (hidden > splat<F>(1e-4f)), full = disc.read & (hidden > splat<F>(1.0f - 1e-4f));
  answer.clear = select(some, select(full, zero, one - hidden), answer.clear);

  // Errors are measured by the disc of the light's part alone and a share of that of the shading points.
  const TubeWidths<F>& widths = tube.widths;
  const F near = min(widths.near_x, widths.near_y) * splat<F>(k_near_share);
  const F half = half_width(stratum, min(widths.x, widths.y), near, disc.t) * splat<F>(field.coverage.half_lines);
  const F coarse = splat<F>(k_coarse_disc / policy.slack), fine = splat<F>(least_disc / policy.slack);
  const Mask_t<F> small = open & (half < select(is_among_thin_features(field, tube, disc, open), coarse, fine));
  const F apart = depths_apart<F>(field, tube, disc, some) / max(half, splat<F>(0.5f));
  const Mask_t<F> layered = some & (apart > splat<F>(k_most_apart * policy.slack));
  answer.refused = answer.refused | and_not(answer.unknown, small | layered);
  return answer;
}

FT_LANES_END

#endif  // toggled guard
