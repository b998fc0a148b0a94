// The loop over hits behind Surfaces::evaluate(), for one lane type. Thread-safety: writes its result only.

#if defined(FIELDTRACE_CORE_SURFACE_SURFACE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SURFACE_SURFACE_BATCH_INL_H_
#undef FIELDTRACE_CORE_SURFACE_SURFACE_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_SURFACE_SURFACE_BATCH_INL_H_
#endif

#include <algorithm>
#include <cstring>

#include "core/surface/surface_kernels.h"
#include "core/surface/surface_lanes.hd.h"

FT_LANES_BEGIN

// Hits are processed in blocks: first all gathers, then the arithmetic, because a processor cannot look ahead over
// both. A multiple of all lane counts.
constexpr size_t k_surface_block = 64;

// Every array is aligned to the widest vectors.
struct alignas(64) SurfaceBlock {
  int32_t place[k_surface_block];  // index in the batch
  float u[k_surface_block], v[k_surface_block];
  float position[9][k_surface_block], normal[9][k_surface_block];  // of the corners, coordinate by coordinate
  int32_t triangle[k_surface_block];                               // of each vector of floats; -1: several
  size_t used = 0;  // hits; later lanes repeat the last hit, whose mesh is the same
};

// Broadcasts the same three rows to all lanes.
template <class F>
FT_HD_INLINE void splat_corners(const std::vector<Vec3>& from, const UVec3& row, size_t i,
                                float (&to)[9][k_surface_block]) {
  for (int corner = 0; corner < 3; ++corner) {
    const Vec3& v = from[row[corner]];
    for (int k = 0; k < 3; ++k) store_lanes(splat<F>(v[k]), to[3 * corner + k] + i);
  }
}

// Gathers three coordinates of each of the three corners.
template <class F>
FT_HD_INLINE void gather_corners(const std::vector<Vec3>& from, const Int_t<F> (&row)[3], size_t i,
                                 float (&to)[9][k_surface_block]) {
  const float* base = &from.data()->x;
  for (int corner = 0; corner < 3; ++corner) {
    for (int k = 0; k < 3; ++k) store_lanes(gather(base + k, row[corner]), to[3 * corner + k] + i);
  }
}

// Whether the `count` places from entry i on are used and follow one another.
FT_HD_INLINE bool is_run(const SurfaceBlock& block, size_t i, size_t count) {
  return i + count <= block.used && block.place[i + count - 1] - block.place[i] == int32_t(count - 1);
}

template <class F>
inline void gather_block(const TriangleMesh& mesh, const HitBatch& hits, SurfaceBlock& block) {
  const auto* const corners = reinterpret_cast<const int32_t*>(mesh.triangles.data());
  const auto* const primitives = reinterpret_cast<const int32_t*>(hits.primitive.data());
  const auto times_three = [](Int_t<F> a) { return a + a + a; };
  constexpr auto k_lanes = size_t(Lanes<F>::k_count);
  for (size_t i = 0; i < block.used; i += k_lanes) {
    const auto begin = size_t(block.place[i]);
    Int_t<F> primitive;
    if (is_run(block, i, k_lanes)) {
      primitive = load_int_lanes_unaligned<F>(primitives + begin);
      std::memcpy(block.u + i, &hits.u[begin], k_lanes * sizeof(float));
      std::memcpy(block.v + i, &hits.v[begin], k_lanes * sizeof(float));
    } else {
      const Int_t<F> place = load_int_lanes<F>(block.place + i);
      primitive = gather(primitives, place);
      store_lanes(gather(hits.u.data(), place), block.u + i);
      store_lanes(gather(hits.v.data(), place), block.v + i);
    }
    const int32_t first = primitives[begin];
    const bool is_one = all(primitive == splat_int<F>(first));  // common on large triangles
    block.triangle[i / k_lanes] = is_one ? first : -1;
    if (is_one) {
      const UVec3& row = mesh.triangles[size_t(first)];
      splat_corners<F>(mesh.positions, row, i, block.position);
      if (!mesh.normals.empty()) splat_corners<F>(mesh.normals, row, i, block.normal);
      continue;
    }
    const Int_t<F> triangle = times_three(primitive);
    const Int_t<F> row[3] = {times_three(gather(corners, triangle)), times_three(gather(corners + 1, triangle)),
                             times_three(gather(corners + 2, triangle))};
    gather_corners<F>(mesh.positions, row, i, block.position);
    if (!mesh.normals.empty()) gather_corners<F>(mesh.normals, row, i, block.normal);
  }
}

// The corners of the triangles from entry i of a block on.
template <class D>
FT_HD_INLINE TriangleCorners<D> block_corners(const float (&from)[9][k_surface_block], size_t i) {
  const auto at = [&](int k) {
    return Vec3Lanes<D>{load_floats<D>(from[k] + i), load_floats<D>(from[k + 1] + i), load_floats<D>(from[k + 2] + i)};
  };
  return {at(0), at(3), at(6)};
}

template <class F, class D>
inline void evaluate_surfaces(const SurfaceTask& task, SurfaceBatch& result) {
  const Instance& instance = task.scene.instances[task.instance];
  const TriangleMesh& mesh = task.scene.shapes[instance.shape].mesh;
  const AffineLanes<D> to_world = splat_affine<D>(&instance.to_world[0][0]);
  const AffineLanes<D> to_object = splat_affine<D>(&instance.to_object[0][0]);
  const D sign = splat_double<D>(instance.flip_normals ? -1.0 : 1.0);
  const bool is_shaded = !mesh.normals.empty();
  float* const arrays[10] = {result.px.data(), result.py.data(),   result.pz.data(), result.gx.data(),
                             result.gy.data(), result.gz.data(),   result.sx.data(), result.sy.data(),
                             result.sz.data(), result.error.data()};
  constexpr auto k_lanes = size_t(DoubleLanes<D>::k_count);
  alignas(64) float values[10][k_lanes];
  SurfaceBlock block;
  TrianglePlane<D> plane = {};
  WorldNormal<D> normal = {};
  int32_t triangle = -1;  // that both belong to
  for (size_t begin = 0; begin < task.places.size(); begin += k_surface_block) {
    block.used = std::min(task.places.size() - begin, k_surface_block);
    std::copy_n(task.places.data() + begin, block.used, block.place);
    std::fill(block.place + block.used, block.place + k_surface_block, block.place[block.used - 1]);
    gather_block<F>(mesh, task.hits, block);
    for (size_t i = 0; i < block.used; i += k_lanes) {
      const int32_t next_triangle = block.triangle[i / size_t(Lanes<F>::k_count)];
      if (next_triangle < 0 || next_triangle != triangle) {
        set_plane(block_corners<D>(block.position, i), plane);
        normal = to_world_normal<D>(to_object, plane.normal);
        triangle = next_triangle;
      }
      const D b1 = load_floats<D>(block.u + i), b2 = load_floats<D>(block.v + i);
      LocalSurface<D> local = triangle_surface<D>(plane, b1, b2);
      if (is_shaded) local.shading = interpolated_normal<D>(block_corners<D>(block.normal, i), b1, b2, local.normal);
      const WorldSurface<D> s = to_world_surface<D>(to_world, to_object, sign, local, normal, is_shaded);
      const D lanes[9] = {s.position.x, s.position.y, s.position.z, s.normal.x, s.normal.y,
                          s.normal.z,   s.shading.x,  s.shading.y,  s.shading.z};
      for (int k = 0; k < 9; ++k) store_floats(lanes[k], values[k]);
      store_next_floats(s.error, values[9]);
      const int32_t* const places = block.place + i;
      if (is_run(block, i, k_lanes)) {
        for (int k = 0; k < 10; ++k) std::memcpy(arrays[k] + places[0], values[k], sizeof(values[k]));
        continue;
      }
      const size_t used = std::min(block.used - i, k_lanes);
      for (size_t j = 0; j < used; ++j) {
        for (int k = 0; k < 10; ++k) arrays[k][places[j]] = values[k][j];
      }
    }
  }
}

FT_LANES_END

#endif  // toggled guard
