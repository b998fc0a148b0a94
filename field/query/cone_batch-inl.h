// The loop over shading points behind SegmentKernels::light_cones. Included once per Highway target and once for
// floats.

#if defined(FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#endif

#include "field/query/cone.hd.h"
#include "field/query/segment_kernels.h"
#include "field/query/stratum.hd.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE Vec3Lanes<F> load_points(const ShadingPointBatch& r, size_t i) {
  return {load_lanes<F>(&r.px[i]), load_lanes<F>(&r.py[i]), load_lanes<F>(&r.pz[i])};
}

// Collects the numbers of slices or tiles that are not baked.
template <class F>
struct MissingList {
  std::vector<uint32_t>& list;
  void operator()(Int_t<F> numbers, Mask_t<F> missing) const {
    alignas(64) int32_t chosen[2 * Lanes<F>::k_count];
    const int n = compress_store(numbers, missing, chosen);
    list.insert(list.end(), chosen, chosen + n);
  }
};

// Whether the whole object, and the light's whole cone too, lie in front of the shading point's tangent plane: then the
// backward part of the cone's lines meets nothing. The object's bounds are a box about the origin; it may reach below
// the plane by the spacing of the lines, which they do not resolve.
template <class F>
FT_HD_INLINE Mask_t<F> faces_object(const ConeTask& task, const LightCone<F>& cone, const Vec3Lanes<F>& world_normal) {
  const float* m = task.from_unit;
  const auto along_column = [&](int i) {
    return splat<F>(m[i]) * world_normal.x + splat<F>(m[i + 1]) * world_normal.y + splat<F>(m[i + 2]) * world_normal.z;
  };
  const Vec3Lanes<F> n = {along_column(0), along_column(3), along_column(6)};
  const F reach = abs(n.x) * splat<F>(task.half_extent[0]) + abs(n.y) * splat<F>(task.half_extent[1]) +
                  abs(n.z) * splat<F>(task.half_extent[2]);
  const FieldView& field = task.segment.field;
  const F length = sqrt(dot(n, n));
  // A direction and its cell's differ by less than the cell's diagonal, of the mean cell 2 sqrt(2 pi) / D.
  const F turn = cone.sine + splat<F>(5.1f / field.directions.cells);
  return (dot(n, cone.p) + reach <= length / splat<F>(field.coverage.half_lines)) & (dot(n, cone.axis) > length * turn);
}

template <class F>
inline ConeCounts light_cones_batch(const ConeTask& task, const ShadingPointBatch& shading_points, const Sphere& light,
                                    std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns& unknowns) {
  ConeCounts counts;
  const float* m = task.segment.to_unit;
  const FieldView& field = task.segment.field;
  const Vec3Lanes<F> centre = {splat<F>(light.centre.x), splat<F>(light.centre.y), splat<F>(light.centre.z)};
  const F stretch = splat<F>(task.segment.to_unit_stretch);
  const F one = splat<F>(1.0f);
  const Int_t<F> may = splat_int<F>(k_may_shadow);
  const Uint_t<F> instance = splat_uint<F>(task.segment.instance);
  for (const uint32_t block : blocks) {
    bool missing = false;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      const Int_t<F> flag = load_int_lanes<F>(flags + i);
      const Mask_t<F> queried = (flag & may) == may;
      if (!any(queried)) continue;
      const Vec3Lanes<F> world = load_points<F>(shading_points, i);
      const Vec3Lanes<F> normal = {load_lanes<F>(&shading_points.gx[i]), load_lanes<F>(&shading_points.gy[i]),
                                   load_lanes<F>(&shading_points.gz[i])};
      const Vec3Lanes<F> p = transformed_point(m, world);
      // A ray's origin lies up to `error` from the shading point: a few roundings, far below the spacing of the lines,
      // which matter only for point lights.
      const F radius = max(splat<F>(light.radius), load_lanes<F>(&shading_points.error[i])) * stretch;
      const F near = load_lanes<F>(&shading_points.radius[i]) * stretch;
      const LightCone<F> cone = make_cone<F>(p, transformed_vector(m, centre - world), radius, near);
      const Mask_t<F> inside = dot(p, p) < (one + near) * (one + near);
      const Mask_t<F> self = queried & (load_uint_lanes<F>(&shading_points.instance[i]) == instance);
      const Mask_t<F> before = (!inside) & (dot(p, cone.axis) < splat<F>(0.0f));
      const Mask_t<F> beyond = light_beyond_ball(cone);
      const Mask_t<F> within = inside & faces_object<F>(task, cone, normal);
      const Mask_t<F> opaque = load_byte_lanes<F>(&shading_points.transmits[i]) == splat_uint<F>(0);
      const Mask_t<F> by_lines = and_not(self, queried & beyond & opaque & (before | within));
      // Depth cells are as wide as a plane cell: within one, shading points see the same.
      const Mask_t<F> by_plane_fit = self & inside & beyond & opaque & (near * splat<F>(field.plane.cells) <= one);
      ConeAnswer<F> answer;
      answer.clear = answer.blocked = answer.unknown = and_not(queried, queried);
      if (any(by_lines)) {
        answer = through_lines<F>(field, task.segment.policy, cone, within, by_lines, MissingList<F>{unknowns.tiles});
        counts.lookups += uint64_t(sum_of(answer.lookups));
      }
      if (task.plane_fit_side > 0 && any(by_plane_fit)) {
        const ConeAnswer<F> on_surface = from_plane_fit<F>(field, task.segment.policy, cone, task.plane_fit_side,
                                                           by_plane_fit, MissingList<F>{unknowns.slices});
        answer.clear = answer.clear | on_surface.clear;
        answer.blocked = answer.blocked | on_surface.blocked;
        answer.unknown = answer.unknown | on_surface.unknown;
        counts.lookups += uint64_t(sum_of(on_surface.lookups));
      }
      missing = missing || any(answer.unknown);
      counts.clear += uint64_t(count_true(answer.clear));
      counts.blocked += uint64_t(count_true(answer.blocked));
      // Strata are tried wherever the object lies in front of the shading point; whether the light ends beyond the ball
      // is tested for each stratum.
      const Mask_t<F> by_strata = and_not(self, queried & opaque & ((!inside) | within));
      const Int_t<F> open = select(by_strata, flag | splat_int<F>(k_by_strata), flag);
      const Int_t<F> found = select(answer.blocked, splat_int<F>(k_light_blocked), open);
      store_lanes(select(answer.clear, splat_int<F>(0), found), flags + i);
    }
    if (missing) unknowns.blocks.push_back(block);
  }
  return counts;
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

template <class F>
inline uint64_t filter_strata_batch(const StratumTask& task, const RayBatch& rays, const float* pdf,
                                    const float* radius, const int32_t* wanted, std::span<const uint32_t> blocks,
                                    float* clear, int32_t* refused, ConeUnknowns& unknowns) {
  uint64_t all_lookups = 0;
  constexpr size_t k_vectors = k_batch_padding / size_t(Lanes<F>::k_count);
  const float* m = task.segment.to_unit;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const F stretch = splat<F>(0.5f * task.segment.to_unit_stretch), share = splat<F>(task.share);
  for (const uint32_t block : blocks) {
    F found[k_vectors];
    Mask_t<F> failed[k_vectors];
    bool missing = false;
    uint64_t lookups = 0;
    for (size_t v = 0; v < k_vectors; ++v) {
      const size_t i = block + v * size_t(Lanes<F>::k_count);
      const F tmax = load_lanes<F>(&rays.tmax[i]);
      const Mask_t<F> queried = (load_int_lanes<F>(wanted + i) > splat_int<F>(0)) & (tmax >= zero);
      found[v] = one;
      failed[v] = and_not(queried, queried);
      if (!any(queried)) continue;
      const Vec3Lanes<F> o = {load_lanes<F>(&rays.ox[i]), load_lanes<F>(&rays.oy[i]), load_lanes<F>(&rays.oz[i])};
      const Vec3Lanes<F> d = {load_lanes<F>(&rays.dx[i]), load_lanes<F>(&rays.dy[i]), load_lanes<F>(&rays.dz[i])};
      const Vec3Lanes<F> q = transformed_vector(m, d);
      const F scale = sqrt(dot(q, q)), density = load_lanes<F>(pdf + i);
      // The stratum's solid angle is share / density; its tube has a square cross-section of that solid angle.
      const F side = select(density > zero, sqrt(share / max(density, splat<F>(1e-30f))), zero);
      LightStratum<F> stratum =
          round_stratum<F>(transformed_point(m, o), q * (one / scale), side * stretch * sqrt(dot(d, d)) / scale);
      const F near = load_lanes<F>(radius + i) * splat<F>(k_square_in_circle);
      stratum.near = stratum.near_bound = near * (stretch + stretch);
      stratum.length = scale;
      if (!task.segment.keeps_angles) {
        transform_tube(task.segment, o, d, side * splat<F>(0.5f), stratum);
        stratum.near = near;
      }
      const StratumAnswer<F> answer = filter_stratum<F>(task.segment.field, task.segment.policy, task.least_disc,
                                                        stratum, tmax * scale, queried, MissingList<F>{unknowns.tiles});
      found[v] = select(queried, answer.clear, one);
      failed[v] = answer.refused;
      missing = missing || any(answer.unknown);
      lookups += uint64_t(sum_of(answer.lookups));
    }
    if (missing) {
      unknowns.blocks.push_back(block);
      continue;
    }
    all_lookups += lookups;
    for (size_t v = 0; v < k_vectors; ++v) {
      const size_t i = block + v * size_t(Lanes<F>::k_count);
      store_lanes(load_lanes<F>(clear + i) * found[v], clear + i);
      store_lanes(select(failed[v], splat_int<F>(1), load_int_lanes<F>(refused + i)), refused + i);
    }
  }
  return all_lookups;
}

FT_LANES_END

#endif  // toggled guard
