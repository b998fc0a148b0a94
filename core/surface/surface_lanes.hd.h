// Points of triangles and bounds on their rounding errors, in double-precision lanes; see core/surface/surface.h.
// Thread-safety: pure functions.

#if defined(FIELDTRACE_CORE_SURFACE_SURFACE_LANES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SURFACE_SURFACE_LANES_HD_H_
#undef FIELDTRACE_CORE_SURFACE_SURFACE_LANES_HD_H_
#else
#define FIELDTRACE_CORE_SURFACE_SURFACE_LANES_HD_H_
#endif

#include "core/simd/double_lanes.hd.h"

FT_LANES_BEGIN

// Bounds on the relative error of 3, 6, 8 and 12 consecutive rounded float operations, as gamma_bound() of
// core/math/math.h.
constexpr double k_gamma_3 = 3 * 0x1p-24 / (1.0 - 3 * 0x1p-24);
constexpr double k_gamma_6 = 6 * 0x1p-24 / (1.0 - 6 * 0x1p-24);
constexpr double k_gamma_8 = 8 * 0x1p-24 / (1.0 - 8 * 0x1p-24);
constexpr double k_gamma_12 = 12 * 0x1p-24 / (1.0 - 12 * 0x1p-24);

// Every relative bound is zero for a surface in a coordinate plane, where an origin on the surface is hit at t = 0 (and
// denormal offsets are flushed to zero). This share of the shape's size is far below the cost of rounding elsewhere
// (2^-24), and its product with the squared size, as in the triangle test, is a normal float for sizes down to 1e-8.
constexpr double k_least_share = 0x1p-40;

template <class D>
FT_HD_INLINE Vec3Lanes<D> magnitudes(const Vec3Lanes<D>& a) {
  return {abs(a.x), abs(a.y), abs(a.z)};
}

template <class M, class D>
FT_HD_INLINE Vec3Lanes<D> select_vector(const M& m, const Vec3Lanes<D>& a, const Vec3Lanes<D>& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}

// A point on a shape with its normals and error, in object space.
template <class D>
struct LocalSurface {
  Vec3Lanes<D> position;
  Vec3Lanes<D> normal;   // geometric, any length
  Vec3Lanes<D> shading;  // any length
  D normal_length;
  // Bound on a ray query's own error in the distance to the surface, along the unit geometric normal.
  D query_error;
};

// The corners' positions or normals.
template <class D>
struct TriangleCorners {
  Vec3Lanes<D> p0, p1, p2;
};

// What the points of a triangle share.
template <class D>
struct TrianglePlane {
  TriangleCorners<D> corners;
  Vec3Lanes<D> normal;  // any length
  D normal_length;
  Vec3Lanes<D> error_terms;  // see query_error
  D least_error;

  // A query computes the triangle's normal as a cross product of rounded edges and projects v0 - o onto it: products of
  // three factors, summed 2 x 3 times, each with about 8 roundings. The absolute products bound the terms, so the error
  // is large only for slivers, where the normal really cancels.
  FT_HD_INLINE D query_error(const Vec3Lanes<D>& to_p0) const {
    const D zero = splat_double<D>(0.0);
    const D of_terms = splat_double<D>(k_gamma_8) * dot(error_terms, magnitudes(to_p0)) / normal_length;
    return select(normal_length > zero, of_terms, zero) + least_error;
  }
};

template <class D>
FT_HD_INLINE void set_plane(const TriangleCorners<D>& t, TrianglePlane<D>& plane) {
  const Vec3Lanes<D> e1 = t.p1 - t.p0, e2 = t.p2 - t.p0, a = magnitudes(e1), b = magnitudes(e2);
  plane.corners = t;
  plane.normal = cross(e1, e2);
  plane.normal_length = sqrt(dot(plane.normal, plane.normal));
  plane.error_terms = {a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x};
  plane.least_error = splat_double<D>(k_least_share) * sqrt(max(dot(e1, e1), dot(e2, e2)));
}

// The point with barycentric coordinates b1, b2 of p1 and p2; `shading` is the geometric normal.
template <class D>
FT_HD_INLINE LocalSurface<D> triangle_surface(const TrianglePlane<D>& plane, D b1, D b2) {
  const TriangleCorners<D>& t = plane.corners;
  const D b0 = splat_double<D>(1.0) - b1 - b2;
  LocalSurface<D> local;
  local.position = t.p0 * b0 + t.p1 * b1 + t.p2 * b2;
  local.normal = local.shading = plane.normal;
  local.normal_length = plane.normal_length;
  local.query_error = plane.query_error(t.p0 - local.position);
  return local;
}

// The interpolated shading normal; `geometric` where the corners' normals cancel out.
template <class D>
FT_HD_INLINE Vec3Lanes<D> interpolated_normal(const TriangleCorners<D>& n, D b1, D b2, const Vec3Lanes<D>& geometric) {
  const Vec3Lanes<D> shading = n.p0 * (splat_double<D>(1.0) - b1 - b2) + n.p1 * b1 + n.p2 * b2;
  return select_vector(dot(shading, shading) > splat_double<D>(0.0), shading, geometric);
}

template <class D>
struct AffineLanes {
  Vec3Lanes<D> x, y, z, t;  // columns

  FT_HD_INLINE Vec3Lanes<D> point(const Vec3Lanes<D>& p) const { return x * p.x + y * p.y + z * p.z + t; }
  // Transforms a normal if this is the inverse transform: multiplies by the transpose. Not normalised.
  FT_HD_INLINE Vec3Lanes<D> normal(const Vec3Lanes<D>& n) const { return {dot(x, n), dot(y, n), dot(z, n)}; }
  // Componentwise |A| |p| + |t|, to which rounding errors of A p + t are relative.
  FT_HD_INLINE Vec3Lanes<D> magnitude(const Vec3Lanes<D>& p) const {
    return magnitudes(x) * abs(p.x) + magnitudes(y) * abs(p.y) + magnitudes(z) * abs(p.z) + magnitudes(t);
  }
};

// `m`: 12 numbers in column-major order.
template <class D>
FT_HD_INLINE AffineLanes<D> splat_affine(const float* m) {
  const auto column = [&](int i) {
    const float* c = m + 3 * i;
    return Vec3Lanes<D>{splat_double<D>(double(c[0])), splat_double<D>(double(c[1])), splat_double<D>(double(c[2]))};
  };
  return {column(0), column(1), column(2), column(3)};
}

// Bound on the rounding error of a surface point at `world`, along its unit normal. normal_length: length of the
// transformed local.normal.
template <class D>
FT_HD_INLINE D rounding_error(const AffineLanes<D>& to_world, const AffineLanes<D>& to_object,
                              const LocalSurface<D>& local, const Vec3Lanes<D>& world, const Vec3Lanes<D>& unit_normal,
                              D normal_length) {
  const D zero = splat_double<D>(0.0);
  const Vec3Lanes<D> n = magnitudes(unit_normal);
  // World space: the position is rounded once, and the offset origin once more in product and sum.
  const D in_world = splat_double<D>(k_gamma_3) * dot(n, magnitudes(world));
  // Object space: 3 products and 3 sums with a matrix that the query inverted itself: its entries are off by a few
  // roundings of magnitudes that |to_object| and |to_world| bound, hence twice the roundings of one transform both
  // ways.
  const D in_object = splat_double<D>(k_gamma_12) * dot(magnitudes(local.normal), to_object.magnitude(world));
  // A plane at distance d in object space is at distance d |n| / |A^-T n| in world space.
  const D carried = (in_object + local.query_error * local.normal_length) / normal_length;
  const D on_the_way = splat_double<D>(k_gamma_6) * dot(n, to_world.magnitude(local.position));
  const auto has_normal = (local.normal_length > zero) & (normal_length > zero);
  return in_world + select(has_normal, carried + on_the_way, zero);
}

// A normal in world space, not reversed.
template <class D>
struct WorldNormal {
  Vec3Lanes<D> unit;
  D length;  // before normalisation
};

// `otherwise` (the z axis) stands for normals of length 0.
template <class D>
FT_HD_INLINE WorldNormal<D> to_world_normal(const AffineLanes<D>& to_object, const Vec3Lanes<D>& local,
                                            const Vec3Lanes<D>& otherwise) {
  const Vec3Lanes<D> normal = to_object.normal(local);
  const D length = sqrt(dot(normal, normal));
  const auto is_normal = length > splat_double<D>(0.0);
  return {select_vector(is_normal, normal * (splat_double<D>(1.0) / length), otherwise), length};
}
template <class D>
FT_HD_INLINE WorldNormal<D> to_world_normal(const AffineLanes<D>& to_object, const Vec3Lanes<D>& local) {
  return to_world_normal<D>(to_object, local, {splat_double<D>(0.0), splat_double<D>(0.0), splat_double<D>(1.0)});
}

// World space; `normal` and `shading` are unit, on the outside.
template <class D>
struct WorldSurface {
  Vec3Lanes<D> position, normal, shading;
  D error;
};

// sign: -1 if the instance's normals are reversed. normal: that of local.normal.
// is_shaded: local.shading may differ from local.normal.
template <class D>
FT_HD_INLINE WorldSurface<D> to_world_surface(const AffineLanes<D>& to_world, const AffineLanes<D>& to_object, D sign,
                                              const LocalSurface<D>& local, const WorldNormal<D>& normal,
                                              bool is_shaded) {
  WorldSurface<D> s;
  s.position = to_world.point(local.position);
  s.error = rounding_error<D>(to_world, to_object, local, s.position, normal.unit, normal.length);
  s.normal = normal.unit * sign;
  s.shading = s.normal;
  if (is_shaded) s.shading = to_world_normal<D>(to_object, local.shading, normal.unit).unit * sign;
  return s;
}

FT_LANES_END

#endif  // toggled guard
