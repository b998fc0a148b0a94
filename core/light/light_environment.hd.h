// Sampling an environment map from points in lanes (its conventions and density: light_environment.h).
//
// Row and column are found by inverting cumulative sums with a binary search of fixed length, the same for every lane:
// log2 W + log2 H steps for a map of W x H. The position within the piece, whose density is linear, is the root of a
// quadratic. An alias table would need a single step, but it makes the map from the square to the sphere discontinuous,
// and low-discrepancy points lose their advantage. See light_shapes.hd.h for the contract of setup() and sample().
// Thread-safety: pure functions that read the tables.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_ENVIRONMENT_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_ENVIRONMENT_HD_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_ENVIRONMENT_HD_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_ENVIRONMENT_HD_H_
#endif

#include "core/light/light_shapes.hd.h"

FT_LANES_BEGIN

// A LightSample with the map's radiance in its direction.
template <class F>
struct EnvironmentSample {
  Vec3Lanes<F> d, normal;
  F height, cos_s, inverse_pdf, pdf;
  Vec3Lanes<F> radiance;
};

template <class F>
FT_HD_INLINE F mix(F a, F b, F t) {
  return a * (splat<F>(1.0f) - t) + b * t;
}
template <class F>
FT_HD_INLINE Vec3Lanes<F> mix(const Vec3Lanes<F>& a, const Vec3Lanes<F>& b, F t) {
  return {mix<F>(a.x, b.x, t), mix<F>(a.y, b.y, t), mix<F>(a.z, b.z, t)};
}

// The t in [0, 1] up to which the linear function from m0 (t = 0) to m1 (t = 1), both non-negative, has the integral q:
// the root of m0 t + (m1 - m0) t^2 / 2 = q in the form without cancellation.
template <class F>
FT_HD_INLINE F invert_linear(F q, F m0, F m1) {
  const F twice = q + q;
  const F square = max(m0 * m0 + (m1 - m0) * twice, splat<F>(0.0f));
  const F t = twice / max(m0 + sqrt(square), splat<F>(Tiny::k_smallest_normal));
  return min(max(t, splat<F>(0.0f)), splat<F>(1.0f));
}

template <class F>
struct EnvironmentLight {
  static constexpr bool k_surface = false, k_finite = false, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = true;
  struct Setup {
    template <class Op>
    FT_HD_INLINE Setup map(const Op&) const {
      return {};
    }
  };
  const float *rows, *sums, *texels;  // EnvironmentTable's
  Vec3Lanes<F> axis_x, axis_y, axis_z, luminance;
  int32_t width, height;
  int32_t first_row_step, first_column_step;  // largest powers of two within the number of strips and of columns

  FT_HD_INLINE EnvironmentLight(const Light& light, const EnvironmentRow* table_rows, const float* table_sums,
                                const float* table_texels)
      : rows(&table_rows->start),
        sums(table_sums),
        texels(table_texels),
        axis_x(splat3<F>(light.axis[0])),
        axis_y(splat3<F>(light.axis[1])),
        axis_z(splat3<F>(light.axis[2])),
        luminance(splat3<F>(light.luminance)),
        width(int32_t(light.width)),
        height(int32_t(light.height)),
        first_row_step(1),
        first_column_step(1) {
    while (first_row_step <= (height - 1) / 2) first_row_step *= 2;
    while (first_column_step <= width / 2) first_column_step *= 2;
  }

  FT_HD_INLINE Setup setup(const LightShadingPoint<F>&) const { return {}; }

  // The last strip whose start is at or below v.
  FT_HD_INLINE Int_t<F> find_strip(F v) const {
    const Int_t<F> stride = splat_int<F>(k_environment_row_floats), last = splat_int<F>(height - 2);
    Int_t<F> strip = splat_int<F>(0);
    for (int32_t step = first_row_step; step > 0; step /= 2) {
      const Int_t<F> next = min(strip + splat_int<F>(step), last);
      strip = select(gather(rows + k_start, next * stride) <= v, max(next, strip), strip);
    }
    return strip;
  }

  // Integral of the density over the columns before x, with weight t between the rows whose sums start at `upper` and
  // `lower`.
  FT_HD_INLINE F sum_before(Int_t<F> x, Int_t<F> upper, Int_t<F> lower, F t) const {
    return mix<F>(gather(sums, upper + x), gather(sums, lower + x), t);
  }

  // The last column whose sum is at or below `target`.
  FT_HD_INLINE Int_t<F> find_column(F target, Int_t<F> upper, Int_t<F> lower, F t) const {
    const Int_t<F> last = splat_int<F>(width - 1);
    Int_t<F> column = splat_int<F>(0);
    for (int32_t step = first_column_step; step > 0; step /= 2) {
      const Int_t<F> next = min(column + splat_int<F>(step), last);
      column = select(sum_before(next, upper, lower, t) <= target, max(next, column), column);
    }
    return column;
  }

  FT_HD_INLINE Vec3Lanes<F> texel(Int_t<F> row, Int_t<F> column) const {
    const Int_t<F> base = (row * splat_int<F>(width) + column) * splat_int<F>(3);
    return {gather(texels, base), gather(texels + 1, base), gather(texels + 2, base)};
  }

  FT_HD_INLINE EnvironmentSample<F> sample(const LightShadingPoint<F>& r, const Setup&, F a, F b, F) const {
    const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
    const F u = from_centred(a), v = from_centred(b);

    const Int_t<F> row = find_strip(v);
    const Int_t<F> above = row * splat_int<F>(k_environment_row_floats);
    const Int_t<F> below = above + splat_int<F>(k_environment_row_floats);
    const F sum_above = gather(rows + k_sum, above), sum_below = gather(rows + k_sum, below);
    const F in_strip = (v - gather(rows + k_start, above)) * gather(rows + k_scale, above);
    const F t = invert_linear<F>(in_strip, sum_above, sum_below);

    const Int_t<F> upper = row * splat_int<F>(width + 1), lower = upper + splat_int<F>(width + 1);
    const F target = u * mix<F>(sum_above, sum_below, t);
    const Int_t<F> column = find_column(target, upper, lower, t);
    const Int_t<F> next_row = row + splat_int<F>(1), next = column + splat_int<F>(1);
    const Int_t<F> next_column = select(to_float(next) < splat<F>(float(width)), next, splat_int<F>(0));
    const Vec3Lanes<F> c00 = texel(row, column), c10 = texel(row, next_column);
    const Vec3Lanes<F> c01 = texel(next_row, column), c11 = texel(next_row, next_column);
    const F left = mix<F>(dot(luminance, c00), dot(luminance, c01), t);
    const F right = mix<F>(dot(luminance, c10), dot(luminance, c11), t);
    const F s = invert_linear<F>(target - sum_before(column, upper, lower, t), left, right);
    const F pdf = mix<F>(left, right, s);

    // 1 - cos theta and 1 + cos theta, each without cancellation where it is small.
    const F delta = gather(rows + k_delta, above);
    const F north = gather(rows + k_north, above) + t * delta;
    const F south = gather(rows + k_south, below) + (one - t) * delta;
    const F up = select(north < south, one - north, south - one);
    const F sine = sqrt(north * south);
    const F whole_turns = (to_float(column) + (s + splat<F>(0.5f))) / splat<F>(float(width));
    const SinCos<F> phi = sincos_turns<F>(select(whole_turns < one, whole_turns, whole_turns - one));
    const Vec3Lanes<F> d = axis_x * (phi.sine * sine) + axis_y * up - axis_z * (phi.cosine * sine);

    // The radiance is bilinear in theta itself.
    const F theta_rows = angle_upper<F>(sine, up) * splat<F>(float(height - 1) * Angle::k_inv_pi);
    const F theta = min(max(theta_rows - to_float(row), zero), one);
    // A piece of density 0 has probability 0 too; samples that rounding puts there are dropped.
    return {d,
            d,
            select(pdf > zero, zero, -one),
            dot(r.shading, d),
            one / max(pdf, splat<F>(Tiny::k_smallest_normal)),
            pdf,
            mix<F>(mix<F>(c00, c10, s), mix<F>(c01, c11, s), theta)};
  }

  static constexpr int k_start = 0, k_sum = 1, k_north = 2, k_south = 3, k_delta = 4, k_scale = 5;  // EnvironmentRow
};

FT_LANES_END

#endif  // toggled guard
