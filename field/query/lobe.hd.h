// A small part of a reflected lobe as seen from a point: the radiance that it meets on one object, filtered from
// prefiltered radiance maps of the object, and the share of it that passes the object.
//
// As for strata of lights (field/query/stratum.hd.h), but in the coverage map as the ray's origin sees it: the tube of
// rays about a sample of the lobe is a disc at the depth of what it meets, and the mean over the lines in that disc is
// what a sample of that solid angle sees. Filtering a sample over its share of the lobe is ray footprint estimation
// (Igehy, "Tracing Ray Differentials", SIGGRAPH 1999) on a pre-shaded object. What the maps do not resolve is refused:
// discs where one texel would blur too much of the lobe, and features as thin as texels where discs are small.
//
// Space: unit space of the object (field/chart/chart.hd.h). Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_LOBE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_LOBE_HD_H_
#undef FIELDTRACE_FIELD_QUERY_LOBE_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_LOBE_HD_H_
#endif

#include "field/query/stratum.hd.h"

FT_LANES_BEGIN

template <class F>
struct LobeAnswer {
  F clear;                  // share of the tube that meets nothing, [0, 1]
  RadianceSum<F> radiance;  // mean over the whole tube, rays that meet nothing counting as black
  F distance;               // from p to what the tube meets
  Mask_t<F> unknown, refused;
  Int_t<F> lookups;
};

// `blur`: the largest tangent that half a texel may subtend as seen from p; for tubes that are not round in world
// space. The shading point lies outside the ball, or within it with the whole object in front of its tangent plane.
template <class F, class TellMissing>
FT_HD_INLINE LobeAnswer<F> filter_lobe(const FieldView& field, const LightStratum<F>& stratum, F blur, Mask_t<F> wanted,
                                       const TellMissing& tell_missing) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f);
  const ConeSpan<F> span = span_of_stratum(stratum);
  LobeAnswer<F> answer;
  answer.clear = one;
  answer.radiance = {zero, zero, zero};
  answer.distance = zero;
  answer.unknown = answer.refused = and_not(wanted, wanted);
  if (stratum.to_unit) answer.refused = wanted & (stratum.bend > splat<F>(k_most_bend));
  const Mask_t<F> queried = and_not(answer.refused, wanted & (span.half > zero));
  answer.lookups = select(queried, splat_int<F>(1), splat_int<F>(0));
  if (!any(queried)) return answer;
  const StratumTube<F> tube = tube_of_stratum<F>(field, SeenFrom::origin, stratum, span, queried, tell_missing);
  answer.unknown = tube.sum.unknown;
  // An outline may pass between two lines: where a texel is too wide even at the far end of the tube, clear is refused
  // too.
  const F half_texel = half / splat<F>(field.coverage.half_lines);
  F unit_blur = blur;
  if (stratum.to_unit) unit_blur = blur * min(tube.widths.x, tube.widths.y) / stratum.world_width;
  answer.refused = answer.refused | (queried & (half_texel > unit_blur * (span.middle + span.half)));
  const Mask_t<F> open = and_not(answer.unknown | (tube.sum.count == splat_int<F>(0)), queried);
  if (!any(open)) return answer;

  const StratumDisc<F> disc = place_disc<F>(field, stratum, tube, open, tell_missing);
  const DiscRects<F> rects(field, stratum, tube, disc);
  const CoverageArea<F> area = sum_disc<F>(tube, rects, tell_missing);
  answer.lookups = answer.lookups + select(open, splat_int<F>(1), splat_int<F>(0)) +
                   select(disc.read, splat_int<F>(1), splat_int<F>(0));
  answer.unknown = answer.unknown | area.unknown;
  answer.distance = disc.t;
  const Mask_t<F> read = and_not(answer.unknown, disc.read & (area.count * rects.per_area > splat<F>(1e-4f)));
  if (any(read)) {
    answer.clear = select(read, min(max(one - area.count * rects.per_area, zero), one), one);
    RadianceSum<F> sum = {zero, zero, zero};
    for (int i = 0; i < rects.count; ++i) {
      const PlaneRect<F> rect = rects.rect(i);
      const RadianceSum<F> part = sum_radiance_area<F>(field.coverage, tube.map.direction, rect, read & has_area(rect));
      sum = {sum.red + part.red, sum.green + part.green, sum.blue + part.blue};
    }
    // Differences of float sums: rounding may take a black object below zero.
    const auto mean = [&](F s) { return select(read, max(s * rects.per_area, zero), zero); };
    answer.radiance = {mean(sum.red), mean(sum.green), mean(sum.blue)};
  }
  const Mask_t<F> blurred = half_texel > unit_blur * disc.t;
  const Mask_t<F> thin =
      is_among_thin_features(field, tube, disc, open) & (disc.least_half() < splat<F>(k_coarse_disc));
  answer.refused = answer.refused | (open & (blurred | thin));
  return answer;
}

FT_LANES_END

#endif  // toggled guard
