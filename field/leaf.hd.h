// A small part of a light as seen from a point ("leaf"): the share of its rays that an object leaves clear, filtered
// from the pictures of coverage tiles. Many leaves make up a light, so that no rays are needed where a light is partly
// hidden.
//
// All rays of a leaf lie in a thin tube about its centre ray. Seen along the direction c of the ray's direction cell,
// at the depth of whatever hides it, the tube is a disc: its share of lines that hit is the share of the leaf that is
// hidden. The depth comes from the picture itself: the mean depth of all that the tube can meet, then that of what lies
// in the disc laid there; the disc is laid once more, and its area summed to fractions of texels. (Percentage-closer
// soft shadows, Fernando, SIGGRAPH 2005 sketches, seek the blocker's depth alike, from one picture for a whole light.)
// Leaves that the pictures do not resolve are refused: discs smaller than about a texel, blockers whose depth does not
// settle, features as thin as the texels.
//
// Space: unit space of the object (field/chart.hd.h). Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_LEAF_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_LEAF_HD_H_
#undef FIELDTRACE_FIELD_LEAF_HD_H_
#else
#define FIELDTRACE_FIELD_LEAF_HD_H_
#endif

#include "field/cone.hd.h"

FT_LANES_BEGIN

// One leaf: its centre ray, of unit direction, and the half width of its tube for each unit of distance from p.
template <class F>
struct LightLeaf {
  Vec3Lanes<F> p, direction;
  F length, width;
};

template <class F>
struct LeafAnswer {
  F clear;  // share of the leaf, [0, 1]
  Mask_t<F> unknown, refused;
  Int_t<F> lookups;
};

// Depths settle: laid at the last depth found, the disc would move by less than this share of its half width.
constexpr float k_leaf_drift = 0.5f;
// Tiles of more grain than this (field/coverage.hd.h) need discs of the second half width, in texels.
constexpr float k_coarse_grain = 0.15f;
constexpr float k_coarse_disc = 4.0f;

// The receiver has the object before it and lies outside the ball, or within it with the whole object before its
// tangent plane. least_disc: half width in texels below which discs are not read.
template <class F, class TellMissing>
FT_HD_INLINE LeafAnswer<F> filter_leaf(const FieldView& field, float least_disc, const LightLeaf<F>& leaf,
                                       Mask_t<F> wanted, const TellMissing& tell_missing) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f);
  LightCone<F> tube;
  tube.p = leaf.p;
  tube.axis = leaf.direction;
  tube.tangent = leaf.width;
  const ConeSpan<F> span = span_in_ball(tube);
  LeafAnswer<F> answer;
  answer.clear = one;
  answer.unknown = and_not(wanted, wanted);
  // A light that ends within the ball is no line's end.
  answer.refused = wanted & (span.half > zero) & (span.middle + span.half > leaf.length);
  const Mask_t<F> asked = and_not(answer.refused, wanted & (span.half > zero));
  answer.lookups = select(asked, splat_int<F>(1), splat_int<F>(0));
  if (!any(asked)) return answer;

  const LinePicture<F> picture = picture_along(field, leaf.direction);
  const Vec3Lanes<F> middle = leaf.p + leaf.direction * span.middle;
  const F cosine = dot(leaf.direction, picture.frame.c);
  const Vec3Lanes<F> across = leaf.direction - picture.frame.c * cosine;
  const F slope = sqrt(dot(across, across));
  const F radius = (span.middle + span.half) * leaf.width + span.half * slope;
  const PictureSquare<F> all = square_about(picture, middle, radius);
  const CoverageSum<F> tube_sum = sum_coverage<F>(field.coverage, picture.direction, all.rect, asked, tell_missing);
  answer.unknown = tube_sum.unknown;
  const Int_t<F> texels = (all.rect.x1 - all.rect.x0) * (all.rect.y1 - all.rect.y0);
  const Mask_t<F> blocked = asked & all.whole & (tube_sum.count == texels);
  answer.clear = select(blocked, zero, one);
  const Mask_t<F> open = and_not(answer.unknown | blocked | (tube_sum.count == splat_int<F>(0)), asked);
  if (!any(open)) return answer;

  // Distance from p at which the centre ray reaches the mean of `depths` of `count` lines.
  const F middle_depth = dot(middle, picture.frame.c);
  const auto reach_of = [&](F depths, F count) {
    const F depth = splat<F>(k_coverage_depth_step) * (depths / max(count, splat<F>(1e-6f))) - one;
    const F t = span.middle + (depth - middle_depth) / max(cosine, half);
    return min(max(t, span.middle - span.half), span.middle + span.half);
  };
  const F scale = splat<F>(field.coverage.half_lines);
  const auto disc_at = [&](F t) { return max(leaf.width * t * scale, half) / scale; };
  const F first = reach_of(to_float(tube_sum.depths), to_float(tube_sum.count));
  const PictureSquare<F> found = square_about(picture, leaf.p + leaf.direction * first, disc_at(first));
  const CoverageSum<F> near = sum_coverage<F>(field.coverage, picture.direction, found.rect, open, tell_missing);
  const Mask_t<F> hit = open & (near.count > splat_int<F>(0));
  const F t = select(hit, reach_of(to_float(near.depths), to_float(near.count)), first);
  const F disc = disc_at(t) * scale;
  const Vec3Lanes<F> centre = leaf.p + leaf.direction * t;
  const F x = picture.texels(centre, picture.frame.s), y = picture.texels(centre, picture.frame.t);
  const F lines = scale + scale;
  const auto within = [&](F value) { return min(max(zero, value), lines); };
  const PlaneRect<F> rect = {within(x - disc), within(x + disc), within(y - disc), within(y + disc)};
  const Mask_t<F> read = hit & (rect.x0 < rect.x1) & (rect.y0 < rect.y1);
  const CoverageArea<F> area = sum_coverage_area<F>(field.coverage, picture.direction, rect, read, tell_missing);
  answer.lookups =
      answer.lookups + select(open, splat_int<F>(1), splat_int<F>(0)) + select(read, splat_int<F>(1), splat_int<F>(0));
  answer.unknown = answer.unknown | near.unknown | area.unknown;
  // Sums of floats: a few roundings beside 0 and 1.
  const F hidden = area.count / (splat<F>(4.0f) * disc * disc);
  const Mask_t<F> some = read & (hidden > splat<F>(1e-4f)), full = read & (hidden > splat<F>(1.0f - 1e-4f));
  answer.clear = select(some, select(full, zero, one - hidden), answer.clear);

  const F drift = abs(reach_of(area.depths, area.count) - t) * slope * scale;
  const Mask_t<F> unsettled = and_not(full, some & (drift > disc * splat<F>(k_leaf_drift)));
  const auto texel = [&](F value) { return small_to_int(min(max(zero, floor(value)), lines - one)); };
  const F grain = grain_at<F>(field.coverage, picture.direction, texel(x), texel(y), open);
  const F least = select(grain > splat<F>(k_coarse_grain), splat<F>(k_coarse_disc), splat<F>(least_disc));
  const Mask_t<F> small = open & (leaf.width * t * scale < least);
  answer.refused = answer.refused | and_not(answer.unknown, small | unsettled);
  return answer;
}

FT_LANES_END

#endif  // toggled guard
