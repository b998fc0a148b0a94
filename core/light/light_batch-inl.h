// The loop over shading points and samples behind sample_light, for one lane type.
//
// Shading points are processed in groups of one per lane, and whatever depends on the shading point alone is computed
// once per group. The group's N * M ray slots form M vectors; for each, the shading points' values are permuted to the
// lanes that need them: not at all for M = 1, one shading point per run of vectors if N divides M, and by an index
// table otherwise. A slot's value depends only on its shading point, the sample number k and the sample point, never on
// its lane, so all lane counts give the same bits. Thread-safety: writes `out` only.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_BATCH_INL_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_BATCH_INL_H_
#endif

#include <algorithm>

#include "core/light/light_environment.hd.h"
#include "core/light/light_kernels.h"
#include "core/light/light_ray.hd.h"
#include "core/light/light_shapes.hd.h"
#include "core/light/light_shapes_area.hd.h"
#include "core/sampling/point_sets.hd.h"
#include "core/sampling/sobol.hd.h"

FT_LANES_BEGIN

template <class F>
struct SpreadLanes {
  LanePermutation<F> permute;
  FT_HD_INLINE F operator()(F a) const { return permute(a); }
  FT_HD_INLINE Uint_t<F> operator()(Uint_t<F> a) const { return permute(a); }
  FT_HD_INLINE Vec3Lanes<F> operator()(const Vec3Lanes<F>& a) const {
    return {permute(a.x), permute(a.y), permute(a.z)};
  }
};

// Output pointers, copied so that the compiler need not reload them after each store.
struct Slots {
  float *ox, *oy, *oz, *dx, *dy, *dz, *tmax, *weight, *pdf, *red, *green, *blue;
  uint32_t* instance;
  uint32_t* cell;
  size_t active = 0;  // so far
  explicit Slots(ShadowBatch& out)
      : ox(out.rays.ox.data()),
        oy(out.rays.oy.data()),
        oz(out.rays.oz.data()),
        dx(out.rays.dx.data()),
        dy(out.rays.dy.data()),
        dz(out.rays.dz.data()),
        tmax(out.rays.tmax.data()),
        weight(out.weight.data()),
        pdf(out.pdf.data()),
        red(out.red.data()),
        green(out.green.data()),
        blue(out.blue.data()),
        instance(out.instance.data()),
        cell(out.cell.data()) {}
};

template <class F, class Kind, bool k_transmits>
struct LightBatch {
  static constexpr int k_lanes = Lanes<F>::k_count;

  const Light& light;
  const int32_t* const point_sets;
  const Kind kind;
  const ShadingPointBatch& shading_points;
  const uint32_t dimension;  // of the light's first pair
  const uint32_t stream;     // set_stream(dimension)
  const LightSampleRange range;
  const size_t slots;
  ShadowBatch& out;

  FT_HD_INLINE ShadingPointLanes<F> load_shading_points(size_t i) const {
    const ShadingPointBatch& b = shading_points;
    const auto at = [i](const AlignedVector<float>& v) { return load_lanes<F>(v.data() + i); };
    const auto uint_at = [i](const AlignedVector<uint32_t>& v) { return load_uint_lanes<F>(v.data() + i); };
    F transmits = splat<F>(0.0f);
    if constexpr (k_transmits) transmits = to_float(as_int(load_byte_lanes<F>(b.transmits.data() + i)));
    const ShadingPointInput<F> in = {{at(b.px), at(b.py), at(b.pz)},
                                     {at(b.gx), at(b.gy), at(b.gz)},
                                     {at(b.sx), at(b.sy), at(b.sz)},
                                     at(b.error),
                                     transmits,
                                     uint_at(b.seed),
                                     uint_at(b.sample),
                                     uint_at(b.instance)};
    return shading_point_lanes<F, Kind, k_transmits>(light, dimension, stream, range, in);
  }

  // The cell of a grid over the sample square that a point lies in.
  FT_HD_INLINE Uint_t<F> cell_of(const CentredPair<F>& point) const {
    const auto along = [](F x, int cells) {
      const F half = splat<F>(0.5f * float(cells));
      return small_to_int(min(floor((x + splat<F>(1.0f)) * half), splat<F>(float(cells - 1))));
    };
    return as_uint(along(point.y, range.cell_rows) * splat_int<F>(range.cell_columns) +
                   along(point.x, range.cell_columns));
  }

  // Writes one vector of slots: sample first_index + k of each lane's shading point.
  FT_HD_INLINE void emit(Slots& to, size_t slot, const ShadingPointLanes<F>& r, const typename Kind::Setup& setup,
                         Uint_t<F> k) const {
    const LightSamplePoint<F> at = light_sample_point<F, Kind>(range, point_sets, r, k);
    emit(to, slot, r, setup, at.point, at.third);
  }

  FT_HD_INLINE void emit(Slots& to, size_t slot, const ShadingPointLanes<F>& r, const typename Kind::Setup& setup,
                         const CentredPair<F>& point, F third) const {
    const auto ray = light_ray<F, Kind, k_transmits>(kind, r, setup, point, third);
    Mask_t<F> active = ray.active;
    if (slot + k_lanes > slots) {  // last vector of the batch: its padding stays inactive
      const Int_t<F> left = splat_int<F>(int32_t(slots - std::min(slot, slots)));
      active = active & (as_int(load_uint_lanes<F>(k_iota.data())) < left);
    }

    const StoredRay<F> stored = stored_ray<F, Kind>(ray, active);
    to.active += size_t(count_true(active));
    store_lanes(ray.origin.x, to.ox + slot);
    store_lanes(ray.origin.y, to.oy + slot);
    store_lanes(ray.origin.z, to.oz + slot);
    store_lanes(stored.d.x, to.dx + slot);
    store_lanes(stored.d.y, to.dy + slot);
    store_lanes(stored.d.z, to.dz + slot);
    store_lanes(stored.tmax, to.tmax + slot);
    store_lanes(stored.weight, to.weight + slot);
    store_lanes(stored.pdf, to.pdf + slot);
    store_lanes(r.instance, to.instance + slot);
    if (range.cell_columns > 0) store_lanes(cell_of(point), to.cell + slot);
    if constexpr (Kind::k_varies) {
      store_lanes(ray.sample.radiance.x, to.red + slot);
      store_lanes(ray.sample.radiance.y, to.green + slot);
      store_lanes(ray.sample.radiance.z, to.blue + slot);
    }
  }

  // The points of a group with one sample per shading point. Consecutive samples of one pixel need no gather.
  FT_HD_INLINE CentredPair<F> group_points(size_t group, const ShadingPointLanes<F>& r) const {
    if constexpr (k_lanes > 1) {
      const uint32_t seed = shading_points.seed[group], index = shading_points.sample[group];
      const auto run = as_uint(lane_sequence<F>(0)) + splat_uint<F>(index) == r.first_index;
      const auto pixel = load_uint_lanes<F>(shading_points.seed.data() + group) == splat_uint<F>(seed);
      if ((index & 255) <= 256 - k_lanes && all(run & pixel)) {
        const uint32_t set = set_sequence<float>(seed, stream).set;
        return load_points<F>(point_sets, set, r.points, index);
      }
    }
    return gather_point<F>(point_sets, r.points, r.first_index);
  }

  // One sample per shading point: the group's lanes are the slots. The points of a block are computed in a separate
  // loop, as two short loops keep more vectors in flight than a long one.
  void run_single() const {
    constexpr size_t k_block = 256;
    alignas(64) float x[k_block], y[k_block];
    Slots to(out);
    for (size_t block = 0; block < shading_points.size; block += k_block) {
      const size_t end = std::min(block + k_block, shading_points.size);
      for (size_t group = block; group < end; group += k_lanes) {
        const ShadingPointLanes<F> r = load_shading_points(group);
        const CentredPair<F> point = group_points(group, r);
        store_lanes(point.x, x + (group - block));
        store_lanes(point.y, y + (group - block));
      }
      for (size_t group = block; group < end; group += k_lanes) {
        const ShadingPointLanes<F> r = load_shading_points(group);
        const CentredPair<F> point = {load_lanes<F>(x + (group - block)), load_lanes<F>(y + (group - block))};
        emit(to, group, r, kind.setup(r.at), point, splat<F>(0.0f));
      }
    }
    out.active = to.active;
  }

  // Sample counts that fill whole vectors: each vector has one shading point and consecutive points of one set.
  void run_whole_vectors() const {
    Slots to(out);
    const size_t m = size_t(range.count);
    alignas(64) int32_t lane[k_lanes * k_lanes];  // lane i, k_lanes times, for each i
    for (int i = 0; i < k_lanes; ++i) std::fill_n(lane + i * k_lanes, k_lanes, i);
    alignas(64) uint32_t set[k_lanes], first_index[k_lanes];
    for (size_t group = 0; group < shading_points.size; group += k_lanes) {
      const ShadingPointLanes<F> r = load_shading_points(group);
      const typename Kind::Setup setup = kind.setup(r.at);
      store_lanes(r.points.set, set);
      store_lanes(r.first_index, first_index);
      const size_t count = std::min(size_t(k_lanes), shading_points.size - group);
      for (size_t i = 0; i < count; ++i) {
        const SpreadLanes<F> spread = {LanePermutation<F>(lane + i * k_lanes)};
        const ShadingPointLanes<F> spread_point = r.map(spread);
        const typename Kind::Setup spread_setup = setup.map(spread);
        for (size_t k = 0; k < m; k += k_lanes) {
          const auto number = as_uint(lane_sequence<F>(range.first + int32_t(k)));
          const auto points =
              range.columns > 0 ? centre_of_cell<F>(range, number)
                                : load_points<F>(point_sets, set[i], spread_point.points, first_index[i] + uint32_t(k));
          emit(to, (group + i) * m + k, spread_point, spread_setup, points, splat<F>(0.0f));
        }
      }
    }
    out.active = to.active;
  }

  void run_mixed() const {
    Slots to(out);
    const size_t m = size_t(range.count);
    // For each vector of a group: the shading point (lane) and sample number of each slot.
    AlignedVector<int32_t> lane(m * k_lanes);
    AlignedVector<uint32_t> sample(m * k_lanes);
    for (size_t i = 0; i < lane.size(); ++i) {
      lane[i] = int32_t(i / m);
      sample[i] = uint32_t(i % m);
    }
    for (size_t group = 0; group < shading_points.size; group += k_lanes) {
      const ShadingPointLanes<F> r = load_shading_points(group);
      const typename Kind::Setup setup = kind.setup(r.at);
      const size_t base = group * m;
      for (size_t j = 0; j < m && base + j * k_lanes < slots; ++j) {
        const SpreadLanes<F> spread = {LanePermutation<F>(lane.data() + j * k_lanes)};
        emit(to, base + j * k_lanes, r.map(spread), setup.map(spread), load_uint_lanes<F>(sample.data() + j * k_lanes));
      }
    }
    out.active = to.active;
  }

  void run() const {
    // The specialised loops are compiled for frequent kinds of light only.
    if constexpr (Kind::k_frequent && !Kind::k_third_number && !k_transmits) {
      if (range.total == 1) return run_single();
      // load_points() needs vectors of points to start at multiples of their length.
      if ((range.total | range.first | range.count) % k_lanes == 0) return run_whole_vectors();
    }
    run_mixed();
  }
};

template <class F>
struct LightLoop {
  const LightTable& table;
  uint32_t index;
  const ShadingPointBatch& shading_points;
  LightSampleRange range;
  ShadowBatch& out;

  template <class Kind, class... Extra>
  void with(const Extra*... extra) const {
    uint8_t transmits = 0;  // no early exit, so that the loop vectorises
    for (size_t i = 0; i < shading_points.size; ++i) transmits |= shading_points.transmits[i];
    const Kind kind(table.lights[index], extra...);
    transmits != 0 ? run_batch<true>(kind) : run_batch<false>(kind);
  }

  template <bool k_transmits, class Kind>
  void run_batch(const Kind& kind) const {
    const uint32_t dimension = k_light_dimension + 2 * index;
    LightBatch<F, Kind, k_transmits>{table.lights[index],
                                     table.point_sets.data(),
                                     kind,
                                     shading_points,
                                     dimension,
                                     set_stream(dimension),
                                     range,
                                     shading_points.size * size_t(range.count),
                                     out}
        .run();
  }

  void run() const {
    switch (table.lights[index].kind) {
      case LightKind::none:
        return;  // sample_light has left every slot inactive
      case LightKind::sphere:
        return with<SphereLight<F>>();
      case LightKind::sphere_inside:
      case LightKind::ellipsoid:
        return with<EllipsoidLight<F>>();
      case LightKind::rectangle:
        return with<RectangleLight<F>>();
      case LightKind::parallelogram:
        return with<ParallelogramLight<F>>();
      case LightKind::disk:
        return with<DiskLight<F>>();
      case LightKind::cylinder:
        return with<CylinderLight<F>>();
      case LightKind::mesh:
        return with<MeshLight<F>>(table.triangles.data());
      case LightKind::point:
        return with<PointLight<F>>();
      case LightKind::directional:
        return with<DirectionalLight<F>>();
      case LightKind::constant:
        return with<ConstantLight<F>>();
      case LightKind::environment:
        return with<EnvironmentLight<F>>(table.environment.rows.data(), table.environment.sums.data(),
                                         table.environment.texels.data());
    }
  }
};

FT_LANES_END

#endif  // toggled guard
