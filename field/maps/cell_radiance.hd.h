// Reads of the diffuse radiance that objects send back, from prefiltered pyramids. Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_RADIANCE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_RADIANCE_HD_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_RADIANCE_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_RADIANCE_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/maps/cell_task.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE F affine(const float* row, const Vec3Lanes<F>& p) {
  return splat<F>(row[0]) * p.x + splat<F>(row[1]) * p.y + splat<F>(row[2]) * p.z + splat<F>(row[3]);
}

template <class F>
FT_HD_INLINE F dot3(const float* a, const Vec3Lanes<F>& b) {
  return splat<F>(a[0]) * b.x + splat<F>(a[1]) * b.y + splat<F>(a[2]) * b.z;
}

// `a` moved into [0, most]; 0 if it is not a number. Look-ups stay within their tables whatever they are asked: what
// max() makes of NaN depends on the instruction set.
template <class F>
FT_HD_INLINE F within_table(F a, F most) {
  const F zero = splat<F>(0.0f);
  return min(select(a > zero, a, zero), most);
}

// Sums of red, green and blue of texels.
template <class F>
struct RadianceRange {
  F least = splat<F>(1e30f), most = splat<F>(0.0f);
  FT_HD_INLINE void add(F a) { least = min(least, a), most = max(most, a); }
  FT_HD_INLINE Mask_t<F> is_uneven(float limit) const { return most - least > splat<F>(0.5f * limit) * (most + least); }
};

// A bilinear read of the level whose texels are nearest to the footprint. begin: of the pyramid, bytes; x, y: texels of
// level 0, moved into the map; footprint: texels. The range of the texels is added to `range`, if given.
template <class F>
FT_HD_INLINE Vec3Lanes<F> read_radiance(const RadianceView& view, Int_t<F> begin, F x, F y, F footprint,
                                        Mask_t<F> wanted, RadianceRange<F>* range = nullptr) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f);
  F scale = one;
  Int_t<F> level_begin = splat_int<F>(0);
  float step = 1.0f, limit = 1.4142135f;  // half way, in powers of two, from the texels of level 0 to those of level 1
  for (int level = 1; level < view.levels; ++level) {
    step *= 0.5f;
    const Mask_t<F> coarser = footprint >= splat<F>(limit);
    scale = select(coarser, splat<F>(step), scale);
    level_begin = select(coarser, splat_int<F>(view.level_begin[level]), level_begin);
    limit *= 2.0f;
  }
  const F side = splat<F>(float(view.texels)) * scale;
  const auto clamped = [&](F a) { return within_table<F>(select(wanted, a * scale - half, zero), side - one); };
  const F column = clamped(x), row = clamped(y);
  const F x0 = min(floor(column), side - splat<F>(2.0f)), y0 = min(floor(row), side - splat<F>(2.0f));
  const F fx = column - x0, fy = row - y0;
  const Int_t<F> width = small_to_int(side);
  const Int_t<F> byte = begin + level_begin + shift_left<2>(small_to_int(y0) * width + small_to_int(x0));
  const Int_t<F> row_bytes = shift_left<2>(width), next = splat_int<F>(4), bits = splat_int<F>(k_radiance_codes);
  Vec3Lanes<F> sum = {zero, zero, zero};
  const auto add = [&](Int_t<F> at, F weight) {
    const Int_t<F> word = gather_bytes(view.words, at);
    const F r = to_float(word & bits), g = to_float(shift_right<10>(word) & bits), b = to_float(shift_right<20>(word));
    const F red = r * r, green = g * g, blue = b * b;
    sum = {sum.x + weight * red, sum.y + weight * green, sum.z + weight * blue};
    if (range) range->add(red + green + blue);
  };
  add(byte, (one - fx) * (one - fy));
  add(byte + next, fx * (one - fy));
  add(byte + row_bytes, (one - fx) * fy);
  add(byte + row_bytes + next, fx * fy);
  return sum * splat<F>(view.scale);
}

// What the side of an object that faces the points sends back along a cell; z: MapLines.
template <class F>
FT_HD_INLINE Vec3Lanes<F> radiance_of_map(const MapRadiance& map, const Vec3Lanes<F>& p, F z, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const F rise = min(max(zero - one - z, zero), one) * (zero - z);
  const F x = affine<F>(map.u, p) + splat<F>(map.slope_u) * rise;
  const F y = affine<F>(map.v, p) + splat<F>(map.slope_v) * rise;
  const Int_t<F> begin = select(z < zero - one, splat_int<F>(map.outer), splat_int<F>(map.inner));
  return read_radiance<F>(*map.view, begin, x, y, splat<F>(map.reach) * max(zero - z, zero), wanted);
}

// What one side of a parallelogram sends back from its coordinates (x, y). begin: of the side's pyramid of window 0,
// bytes; footprint: world units.
template <class F>
FT_HD_INLINE Vec3Lanes<F> read_plane(const PlaneRadiance& plane, Int_t<F> begin, F x, F y, F footprint,
                                     Mask_t<F> wanted, RadianceRange<F>* range = nullptr) {
  F u = splat<F>(0.0f), v = u, density = u;
  Int_t<F> pyramid = begin;
  for (int w = 0; w < plane.windows; ++w) {
    const RadianceWindow& window = plane.window[w];
    const F wu = (x - splat<F>(window.x)) * splat<F>(window.per_unit_x);
    const F wv = (y - splat<F>(window.y)) * splat<F>(window.per_unit_y);
    const F middle = splat<F>(0.5f * float(plane.view->texels));
    const Mask_t<F> inside = (abs(wu) <= middle) & (abs(wv) <= middle);
    const Mask_t<F> take = w == 0 ? inside | !inside : inside;
    u = select(take, wu + middle, u), v = select(take, wv + middle, v);
    density = select(take, splat<F>(window.density), density);
    pyramid = select(take, begin + splat_int<F>(2 * w * plane.view->bytes), pyramid);
  }
  return read_radiance<F>(*plane.view, pyramid, u, v, footprint * density, wanted, range);
}

template <class F>
FT_HD_INLINE Int_t<F> side_of_plane(const PlaneRadiance& plane, F height) {
  return select(height > splat<F>(0.0f), splat_int<F>(plane.begin), splat_int<F>(plane.begin + plane.view->bytes));
}

// What a parallelogram sends back to points at its coordinates (x, y) and signed `height`, along a direction that nears
// it by `fall` per unit of length; `slope` is that of the direction, width that of the cell, radians. Where what stands
// on it ends the direction before, at `reach`, the part of the parallelogram that is seen lies before, or elsewhere.
// `range` becomes that of all texels read.
template <class F>
FT_HD_INLINE Vec3Lanes<F> radiance_of_plane(const PlaneRadiance& plane, const PlaneSlope& slope, F x, F y, F height,
                                            F fall, float width, F reach, Mask_t<F> wanted, RadianceRange<F>& range) {
  const F one = splat<F>(1.0f), least = splat<F>(0.5f * width);  // across the horizon the cell's middle may miss it
  const F nears = max(fall, least), distance = abs(height) / nears;
  const Int_t<F> side = side_of_plane<F>(plane, height);
  const F footprint = splat<F>(k_footprint * width) * distance / sqrt(nears);
  const auto read = [&](F along) {
    const auto within = [&](F a) { return min(max(a, splat<F>(-1.0f)), one); };
    const F ax = within(x + splat<F>(slope.dx) * along), ay = within(y + splat<F>(slope.dy) * along);
    return read_plane<F>(plane, side, ax, ay, footprint, wanted, &range);
  };
  const Vec3Lanes<F> far = read(distance);
  const Mask_t<F> ends_before = wanted & (reach < distance);
  if (!any(ends_before)) return far;
  const Vec3Lanes<F> near = read(select(ends_before, reach, distance));
  const Mask_t<F> adjoins = ends_before & (abs(height) - nears * reach <= splat<F>(width) * reach);
  return {select(adjoins, near.x, far.x), select(adjoins, near.y, far.y), select(adjoins, near.z, far.z)};
}

FT_LANES_END

#endif  // toggled guard
