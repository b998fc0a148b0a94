// Sampling the kinds of light with next to no setup: shapes by area, point, directional and constant.
//
// A unit shape's uniform point p with normal n, under the affine map x -> L x + c: world area is |det L| |L^-T n| times
// the unit shape's area, and the world normal is along L^-T n. For planar shapes the factor is constant.
// See light_shapes.hd.h for the contract of setup() and sample(). Thread-safety: pure functions; meshes read the table.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_AREA_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_AREA_HD_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_AREA_HD_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_AREA_HD_H_
#endif

#include "core/light/light_shapes.hd.h"

FT_LANES_BEGIN

// The vector from the origin to the light's centre is all that the samples of these kinds share.
template <class F>
struct CentreSetup {
  Vec3Lanes<F> to_centre;
  template <class Op>
  FT_HD_INLINE CentreSetup map(const Op& op) const {
    return {op(to_centre)};
  }
};

template <class F>
struct ParallelogramLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = false;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> centre, axis_x, axis_y, normal;
  F area;
  FT_HD explicit ParallelogramLight(const Light& light)
      : centre(splat3<F>(light.centre)),
        axis_x(splat3<F>(light.axis[0])),
        axis_y(splat3<F>(light.axis[1])),
        normal(splat3<F>(light.normal)),
        area(splat<F>(light.area)) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const { return {centre - r.origin}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    return sample_by_area<F>(r, s.to_centre + (axis_x * a + axis_y * b), normal, area);
  }
};

template <class F>
struct DiskLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> centre, axis_x, axis_y, normal;
  F area;
  FT_HD explicit DiskLight(const Light& light)
      : centre(splat3<F>(light.centre)),
        axis_x(splat3<F>(light.axis[0])),
        axis_y(splat3<F>(light.axis[1])),
        normal(splat3<F>(light.normal)),
        area(splat<F>(light.area)) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const { return {centre - r.origin}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const DiskPoint<F> p = concentric_disk_centred<F>(a, b);
    const Vec3Lanes<F> offset = (axis_x * p.cosine + axis_y * p.sine) * p.radius;
    return sample_by_area<F>(r, s.to_centre + offset, normal, area);
  }
};

// The affine image of a point of a unit shape and of its normal; `density_scale` is |det L| |L^-T n|.
template <class F>
struct AffineShape {
  Vec3Lanes<F> axis[3], normal_axis[3];
  F area;
  FT_HD explicit AffineShape(const Light& light)
      : axis{splat3<F>(light.axis[0]), splat3<F>(light.axis[1]), splat3<F>(light.axis[2])},
        normal_axis{splat3<F>(light.normal_axis[0]), splat3<F>(light.normal_axis[1]), splat3<F>(light.normal_axis[2])},
        area(splat<F>(light.area)) {}
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Vec3Lanes<F>& to_centre,
                                     const Vec3Lanes<F>& point, const Vec3Lanes<F>& unit_normal) const {
    const Vec3Lanes<F> offset = axis[0] * point.x + axis[1] * point.y + axis[2] * point.z;
    const Vec3Lanes<F> n =
        normal_axis[0] * unit_normal.x + normal_axis[1] * unit_normal.y + normal_axis[2] * unit_normal.z;
    const F length = sqrt(dot(n, n));
    return sample_by_area<F>(r, to_centre + offset, n * (splat<F>(1.0f) / length), area * length);
  }
};

template <class F>
struct EllipsoidLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = false;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> centre;
  AffineShape<F> shape;
  FT_HD explicit EllipsoidLight(const Light& light) : centre(splat3<F>(light.centre)), shape(light) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const { return {centre - r.origin}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const Vec3Lanes<F> p = uniform_sphere<F>(from_centred(a), from_centred(b));
    return shape.sample(r, s.to_centre, p, p);
  }
};

template <class F>
struct CylinderLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = false;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> centre;
  AffineShape<F> shape;
  FT_HD explicit CylinderLight(const Light& light) : centre(splat3<F>(light.centre)), shape(light) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const { return {centre - r.origin}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const SinCos<F> angle = sincos_turns<F>(from_centred(a));
    return shape.sample(r, s.to_centre, {angle.cosine, angle.sine, from_centred(b)},
                        {angle.cosine, angle.sine, splat<F>(0.0f)});
  }
};

template <class F>
struct MeshLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = true, k_frequent = false;
  static constexpr bool k_varies = false;
  struct Setup {
    template <class Op>
    FT_HD_INLINE Setup map(const Op&) const {
      return {};
    }
  };
  const float* triangles;  // of this light, k_light_triangle_floats each
  uint32_t count;
  uint32_t first_step;  // largest power of two <= count
  FT_HD_INLINE MeshLight(const Light& light, const LightTriangle* table)
      : triangles(table[light.first_triangle].p0), count(light.triangle_count), first_step(1) {
    while (first_step <= count / 2) first_step *= 2;
  }
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>&) const { return {}; }

  FT_HD_INLINE Vec3Lanes<F> gather3(Int_t<F> base, int member) const {
    return {gather(triangles + member, base), gather(triangles + member + 1, base),
            gather(triangles + member + 2, base)};
  }

  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup&, F a, F b, F w) const {
    // The last triangle whose cdf is <= w, by binary search of fixed length.
    const Int_t<F> stride = splat_int<F>(k_light_triangle_floats);
    const Int_t<F> last = splat_int<F>(int32_t(count) - 1);
    Int_t<F> index = splat_int<F>(0);
    for (uint32_t step = first_step; step > 0; step /= 2) {
      const Int_t<F> next = min(index + splat_int<F>(int32_t(step)), last);
      const F cdf = gather(triangles + k_cdf, next * stride);
      index = select(cdf <= w, max(next, index), index);
    }
    const Int_t<F> base = index * stride;
    const Barycentric<F> p = uniform_triangle<F>(from_centred(a), from_centred(b));
    const Vec3Lanes<F> point = gather3(base, 0) + (gather3(base, 3) * p.b1 + gather3(base, 6) * p.b2);
    return sample_by_area<F>(r, point - r.origin, gather3(base, 9), gather(triangles + k_inverse_density, base));
  }

  static constexpr int k_inverse_density = 12, k_cdf = 13;  // members of LightTriangle, in floats
};

template <class F>
struct PointLight {
  static constexpr bool k_surface = false, k_finite = true, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> centre;
  FT_HD explicit PointLight(const Light& light) : centre(splat3<F>(light.centre)) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const { return {centre - r.origin}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F, F, F) const {
    const F length = sqrt(dot(s.to_centre, s.to_centre));
    const F inverse_length = splat<F>(1.0f) / max(length, r.delta);
    // Ends delta before the position, so that a surface on which the light sits does not block it.
    const Vec3Lanes<F> d = s.to_centre * max(splat<F>(1.0f) - r.delta * inverse_length, splat<F>(0.0f));
    return {d,
            {splat<F>(0.0f), splat<F>(0.0f), splat<F>(1.0f)},
            length - r.delta,
            dot(r.shading, s.to_centre) * inverse_length,
            inverse_length * inverse_length,
            splat<F>(0.0f)};
  }
};

template <class F>
struct DirectionalLight {
  static constexpr bool k_surface = false, k_finite = false, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  using Setup = CentreSetup<F>;
  Vec3Lanes<F> towards;
  FT_HD explicit DirectionalLight(const Light& light) : towards(splat3<F>(light.centre)) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>&) const { return {towards}; }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup&, F, F, F) const {
    return {towards, towards, splat<F>(0.0f), dot(r.shading, towards), splat<F>(1.0f), splat<F>(0.0f)};
  }
};

// Cosine-weighted about the shading normal; uniform over the sphere for shading points that transmit.
template <class F>
struct ConstantLight {
  static constexpr bool k_surface = false, k_finite = false, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  struct Setup {
    Vec3Lanes<F> x, y;
    template <class Op>
    FT_HD_INLINE Setup map(const Op& op) const {
      return {op(x), op(y)};
    }
  };
  FT_HD explicit ConstantLight(const Light&) {}
  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const {
    const Basis<F> b = make_basis<F>(r.shading);
    return {b.x, b.y};
  }
  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
    const DiskPoint<F> p = concentric_disk_centred<F>(a, b);
    const F rest = (one - p.radius) * (one + p.radius);
    const F root = sqrt(rest);
    const auto whole = r.transmits > zero;
    const F z = select(whole, rest - p.radius * p.radius, root);
    const F xy = select(whole, (p.radius + p.radius) * root, p.radius);
    const F pdf = select(whole, splat<F>(Angle::k_inv_four_pi), z * splat<F>(Angle::k_inv_pi));
    const F inverse_pdf =
        select(whole, splat<F>(Angle::k_four_pi), splat<F>(Angle::k_pi) / max(root, splat<F>(Tiny::k_smallest_normal)));
    return {s.x * (xy * p.cosine) + s.y * (xy * p.sine) + r.shading * z, r.shading, zero, z, inverse_pdf, pdf};
  }
};

FT_LANES_END

#endif  // toggled guard
