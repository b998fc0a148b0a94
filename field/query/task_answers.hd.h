// What is asked of one candidate object (field/query/query_tasks.h), answered for one shading point, stratum, ray or
// sample of a lobe in each lane. The CPU's batches (field/query/segment_batch-inl.h) and the GPU's kernels
// (gpu/kernels.cu) call these.
//
// Space: world space, transformed by the tasks. Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_TASK_ANSWERS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_TASK_ANSWERS_HD_H_
#undef FIELDTRACE_FIELD_QUERY_TASK_ANSWERS_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_TASK_ANSWERS_HD_H_
#endif

#include "field/query/cone.hd.h"
#include "field/query/lobe.hd.h"
#include "field/query/query.hd.h"
#include "field/query/query_tasks.h"
#include "field/query/stratum.hd.h"

FT_LANES_BEGIN

// A direction and its cell's differ by less than the cell's diagonal; that of the mean cell is 2 sqrt(2 pi) / D.
template <class F>
FT_HD_INLINE F most_turn(const FieldView& field) {
  return splat<F>(5.1f / field.directions.cells);
}

// Whether the whole object, and the light's whole cone too, lie in front of the shading point's tangent plane: then the
// backward part of the cone's lines meets nothing. The object's bounds are a box about the origin; it may reach below
// the plane by the spacing of the lines, which they do not resolve.
template <class F>
FT_HD_INLINE Mask_t<F> faces_object(const ConeTask& task, const LightCone<F>& cone, const Vec3Lanes<F>& world_normal) {
  const Vec3Lanes<F> n = transposed_vector(task.from_unit, world_normal);
  const F reach = abs(n.x) * splat<F>(task.half_extent[0]) + abs(n.y) * splat<F>(task.half_extent[1]) +
                  abs(n.z) * splat<F>(task.half_extent[2]);
  const FieldView& field = task.segment.field;
  const F length = sqrt(dot(n, n));
  const F turn = cone.sine + most_turn<F>(field);
  return (dot(n, cone.p) + reach <= length / splat<F>(field.coverage.half_lines)) & (dot(n, cone.axis) > length * turn);
}

// Whether the backward part of no line of the cone, seen along its cell's direction, meets the object's ball, which the
// points lie outside of: a line through p meets it behind p if its direction d has d.p > sqrt(p^2 - 1).
template <class F>
FT_HD_INLINE Mask_t<F> is_before_ball(const FieldView& field, const LightCone<F>& cone) {
  const F one = splat<F>(1.0f), squared = dot(cone.p, cone.p), length = sqrt(squared);
  const F most = dot(cone.p, cone.axis) + length * (cone.sine + most_turn<F>(field)) + cone.near;
  return (squared > (one + cone.near) * (one + cone.near)) & (most < sqrt(max(squared - one, splat<F>(0.0f))));
}

// A shading point as whole lights are answered for it (core/light/shading_points.h).
template <class F>
struct PointLanes {
  Vec3Lanes<F> p, normal;
  F error, radius;
  Mask_t<F> on_object, opaque;  // lies on the task's instance; carries no light from below its surface
};

template <class F>
struct PointAnswer {
  ConeAnswer<F> cone;
  Mask_t<F> by_strata;  // strata may be tried where the cone stays open
};

// Is the whole ball about `centre` clear of the task's object, as seen from the points `queried`, or hidden by it?
// tell_tile, tell_slice: (numbers, mask) of what is not baked.
template <class F, class TellTile, class TellSlice>
FT_HD_INLINE PointAnswer<F> answer_light(const ConeTask& task, const PointLanes<F>& point, const Vec3Lanes<F>& centre,
                                         F light_radius, Mask_t<F> queried, const TellTile& tell_tile,
                                         const TellSlice& tell_slice) {
  const float* m = task.segment.to_unit;
  const FieldView& field = task.segment.field;
  const F one = splat<F>(1.0f), stretch = splat<F>(task.segment.to_unit_stretch);
  const Vec3Lanes<F> p = transformed_point(m, point.p);
  // A ray's origin lies up to `error` from the shading point: a few roundings, far below the spacing of the lines,
  // which matter only for point lights.
  const F radius = max(light_radius, point.error) * stretch;
  const F near = point.radius * stretch;
  const LightCone<F> cone = make_cone<F>(p, transformed_vector(m, centre - point.p), radius, near);
  const Mask_t<F> inside = dot(p, p) < (one + near) * (one + near);
  const Mask_t<F> self = queried & point.on_object;
  const Mask_t<F> before = is_before_ball<F>(field, cone);
  const Mask_t<F> beyond = light_beyond_ball(cone);
  const Mask_t<F> within = inside & faces_object<F>(task, cone, point.normal);
  const Mask_t<F> by_lines = and_not(self, queried & beyond & point.opaque & (before | within));
  // Depth cells are as wide as a plane cell: within one, shading points see the same.
  const Mask_t<F> by_plane_fit = self & inside & beyond & point.opaque & (near * splat<F>(field.plane.cells) <= one);
  PointAnswer<F> answer;
  answer.cone.clear = answer.cone.blocked = answer.cone.unknown = and_not(queried, queried);
  answer.cone.lookups = splat_int<F>(0);
  if (any(by_lines)) answer.cone = through_lines<F>(field, task.segment.policy, cone, within, by_lines, tell_tile);
  if (task.plane_fit_side > 0 && any(by_plane_fit)) {
    const ConeAnswer<F> on_surface =
        from_plane_fit<F>(field, task.segment.policy, cone, task.plane_fit_side, by_plane_fit, tell_slice);
    answer.cone.clear = answer.cone.clear | on_surface.clear;
    answer.cone.blocked = answer.cone.blocked | on_surface.blocked;
    answer.cone.unknown = answer.cone.unknown | on_surface.unknown;
    answer.cone.lookups = answer.cone.lookups + on_surface.lookups;
  }
  // Strata are tried wherever the object lies in front of the shading point; whether the light ends beyond the ball is
  // tested for each stratum.
  answer.by_strata = and_not(self, queried & point.opaque & (before | within));
  return answer;
}

// Makes a stratum's tube that which the instance's transform makes of a tube of half width `world_width` about the ray
// from o along d in world space. The ray is anchored where it passes the ball's centre: seen from far outside the ball
// (thin instances), rounding of its origin would move it by more than a texel.
template <class F>
FT_HD_INLINE void transform_tube(const SegmentTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d, F world_width,
                                 LightStratum<F>& stratum) {
  const Vec3Lanes<F> q = transformed_vector(task.to_unit, d);
  const F scale = sqrt(dot(q, q)), length = sqrt(dot(d, d)), zero = splat<F>(0.0f);
  const F t = (zero - dot(transformed_point(task.to_unit, o), q)) / (scale * scale);
  stratum.p = transformed_point(task.to_unit, o + d * t);
  stratum.offset = t * scale;
  stratum.to_unit = task.to_unit;
  stratum.world_width = world_width;
  stratum.world_unit = length / scale;
  // Of an offset e across the ray, A e across q = A d has the length |A d x A e| / |A d|, and A d x A e is the cofactor
  // matrix' image of d x e.
  stratum.width = world_width * stratum.world_unit * (stratum.world_unit * splat<F>(task.to_unit_area));
  stratum.bend = world_width * stratum.world_unit * splat<F>(task.to_unit_stretch);
}

// Half side of a square about the centre of a circle, by its radius. The points of a cluster mostly fill a pixel.
constexpr float k_square_in_circle = 0.70710678f;

// The share of a stratum that the task's object leaves clear, for the rays `queried`: (o, d, tmax) is the centre of a
// stratum of density pdf (1/sr) seen from points within `radius` of o (world units). `clear` is 1 in other lanes.
template <class F, class TellTile>
FT_HD_INLINE StratumAnswer<F> answer_stratum(const StratumTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                             F tmax, F pdf, F radius, Mask_t<F> queried, const TellTile& tell_tile) {
  const float* m = task.segment.to_unit;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const F stretch = splat<F>(0.5f * task.segment.to_unit_stretch), share = splat<F>(task.share);
  const Vec3Lanes<F> q = transformed_vector(m, d);
  const F scale = sqrt(dot(q, q));
  // The stratum's solid angle is share / pdf; its tube has a square cross-section of that solid angle.
  const F side = select(pdf > zero, sqrt(share / max(pdf, splat<F>(1e-30f))), zero);
  LightStratum<F> stratum =
      round_stratum<F>(transformed_point(m, o), q * (one / scale), side * stretch * sqrt(dot(d, d)) / scale);
  const F near = radius * splat<F>(k_square_in_circle);
  stratum.near = stratum.near_bound = near * (stretch + stretch);
  stratum.length = scale;
  if (!task.segment.keeps_angles) {
    transform_tube(task.segment, o, d, side * splat<F>(0.5f), stratum);
    stratum.near = near;
  }
  StratumAnswer<F> answer = filter_stratum<F>(task.segment.field, task.segment.policy, task.least_disc, stratum,
                                              tmax * scale, queried, tell_tile);
  answer.clear = select(queried, answer.clear, one);
  return answer;
}

// Half width of a sample's tube, relative to the side of a square of its solid angle. Half of that area is read, which
// leaves three fifths of the bias of reading all of it, with a twentieth more noise (docs/decisions/015-glossy.md).
constexpr float k_lobe_share = 0.35f;
// A sample in the far tail of a lobe stands for a large part of the sphere: no tube is wider than this tangent.
constexpr float k_widest_lobe = 0.12f;

// A sample of a reflected lobe: a ray that stands for 1 / density of solid angle.
template <class F>
struct LobeLanes {
  LightStratum<F> stratum;
  Vec3Lanes<F> p;    // the shading point
  F scale, stretch;  // unit-space length of the ray's world direction; bound on that of its neighbours, relative to it
  Mask_t<F> meets;   // the object's ball
};

// (o, d, tmax): inactive if tmax < 0 or density <= 0.
template <class F>
FT_HD_INLINE LobeLanes<F> make_lobe(const ConeTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d, F tmax,
                                    F density) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const float* m = task.segment.to_unit;
  const Vec3Lanes<F> q = transformed_vector(m, d);
  LobeLanes<F> lobe;
  lobe.scale = sqrt(dot(q, q));
  lobe.p = transformed_point(m, o);
  // The side of a square of about the sample's solid angle.
  const F side = sqrt(one / max(density, splat<F>(1e-30f)));
  lobe.stretch = splat<F>(task.segment.to_unit_stretch) / lobe.scale;
  const F width = min(side * splat<F>(k_lobe_share) * lobe.stretch, splat<F>(k_widest_lobe));
  lobe.stratum = round_stratum<F>(lobe.p, q * (one / lobe.scale), width);
  const Mask_t<F> active = (tmax >= zero) & (density > zero);
  if (!task.segment.keeps_angles) {
    LightStratum<F>& stratum = lobe.stratum;
    transform_tube(task.segment, o, d, side * splat<F>(k_lobe_share), stratum);
    const F narrowed = splat<F>(k_widest_lobe) / max(stratum.width, splat<F>(k_widest_lobe));
    for (F* extent : {&stratum.width, &stratum.world_width, &stratum.bend}) *extent = *extent * narrowed;
  }
  lobe.meets = active & ((span_of_stratum(lobe.stratum).half > zero) | (lobe.stratum.bend > splat<F>(k_most_bend)));
  return lobe;
}

// What the object sends along a sample of a lobe. The ray leaves a surface with the geometric normal `normal`, on the
// ray's side; on_object: the task's instance. Refused unless it leaves another object, from outside this one's ball or
// with all of this one in front. `distance`: in units of the ray's direction, 0 where clear is 1. blur: as filter_lobe.
template <class F, class TellTile>
FT_HD_INLINE LobeAnswer<F> answer_lobe(const ConeTask& task, const LobeLanes<F>& lobe, const Vec3Lanes<F>& normal,
                                       Mask_t<F> on_object, F blur, const TellTile& tell_tile) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  LightCone<F> cone;
  cone.near = zero;
  cone.p = lobe.p;
  cone.axis = lobe.stratum.direction;
  cone.sine = lobe.stratum.width;
  const Mask_t<F> outside = !(dot(lobe.p, lobe.p) < one);
  const Mask_t<F> wanted = and_not(on_object, lobe.meets & (outside | faces_object<F>(task, cone, normal)));
  LobeAnswer<F> answer;
  answer.clear = one;
  answer.radiance = {zero, zero, zero};
  answer.distance = zero;
  answer.unknown = answer.refused = and_not(wanted, wanted);
  answer.lookups = splat_int<F>(0);
  if (any(wanted)) {
    const F unit_blur = task.segment.keeps_angles ? blur / max(lobe.stretch, one) : blur;
    answer = filter_lobe<F>(task.segment.field, lobe.stratum, unit_blur, wanted, tell_tile);
    answer.distance = select(answer.clear < one, answer.distance / lobe.scale, zero);
  }
  answer.refused = answer.refused | and_not(wanted, lobe.meets);
  return answer;
}

// The verdict about a segment. `on_object`: its shading point lies on the task's instance. The CPU's batches run the
// same steps over many segments each (field/query/segment_batch-inl.h).
template <class F>
FT_HD_INLINE SegmentVerdict<F> answer_segment(const SegmentTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                              F tmax, Mask_t<F> on_object) {
  UnitSegment<F> segment;
  write_segment(task.to_unit, o, d, tmax, segment);
  const Mask_t<F> self = segment.crosses & on_object & segment.origin_inside;
  const Mask_t<F> wanted = task.self_only ? and_not(self, self) : line_wanted(segment, self);
  LineView<F> line = {wanted, wanted, wanted, splat_int<F>(0)};
  if (any(wanted)) line = look_up_line(task.field, task.policy, segment);
  LineAnswer<F> answer = answer_by_line(segment, wanted, line);
  if (task.self_only) answer.depth_wanted = self;
  if (task.reads_depth && any(answer.depth_wanted)) {
    const DepthAnchor<F> anchor = depth_anchor(segment);
    answer_by_depth(task.field, task.policy, segment, anchor,
                    address_of_line(anchor.direction, anchor.p, task.field.directions, task.field.plane),
                    answer.depth_wanted, answer.verdict);
  }
  return answer.verdict;
}

FT_LANES_END

#endif  // toggled guard
