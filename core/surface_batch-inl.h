// The loop over hits behind Surfaces::evaluate(), for one lane type. Thread-safety: writes its result only.

#if defined(FIELDTRACE_CORE_SURFACE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SURFACE_BATCH_INL_H_
#undef FIELDTRACE_CORE_SURFACE_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_SURFACE_BATCH_INL_H_
#endif

#include <algorithm>

#include "core/surface_kernels.h"
#include "core/surface_lanes.hd.h"

FT_LANES_BEGIN

// Rows of three numbers a corner, as meshes hold positions and normals.
template <class D>
FT_HD_INLINE Vec3Lanes<D> gather_vectors(const std::vector<Vec3>& from, Index_t<D> corner) {
  const float* base = &from.data()->x;
  const Index_t<D> row = corner + corner + corner;
  return {gather_floats<D>(base, row), gather_floats<D>(base + 1, row), gather_floats<D>(base + 2, row)};
}

// The surface of a triangle given by its corners' indices.
template <class D>
FT_HD_INLINE LocalSurface<D> mesh_surface(const TriangleMesh& mesh, Index_t<D> i0, Index_t<D> i1, Index_t<D> i2, D b1,
                                          D b2) {
  const auto corners = [&](const std::vector<Vec3>& from) {
    return TriangleCorners<D>{gather_vectors<D>(from, i0), gather_vectors<D>(from, i1), gather_vectors<D>(from, i2)};
  };
  LocalSurface<D> local = triangle_surface<D>(corners(mesh.positions), b1, b2);
  if (!mesh.normals.empty()) {
    const TriangleCorners<D> n = corners(mesh.normals);
    const Vec3Lanes<D> shading = n.p0 * (splat_double<D>(1.0) - b1 - b2) + n.p1 * b1 + n.p2 * b2;
    const auto found = dot(shading, shading) > splat_double<D>(0.0);
    local.shading = {select(found, shading.x, local.shading.x), select(found, shading.y, local.shading.y),
                     select(found, shading.z, local.shading.z)};
  }
  return local;
}

template <class D>
inline void evaluate_surfaces(const SurfaceTask& task, SurfacePoint* result) {
  constexpr size_t k_lanes = DoubleLanes<D>::k_count;
  const Instance& instance = task.scene.instances[task.instance];
  const TriangleMesh& mesh = task.scene.shapes[instance.shape].mesh;
  const AffineLanes<D> to_world = splat_affine<D>(&instance.to_world[0][0]);
  const AffineLanes<D> to_object = splat_affine<D>(&instance.to_object[0][0]);
  const D sign = splat_double<D>(instance.flip_normals ? -1.0 : 1.0);
  const auto* const corners = reinterpret_cast<const int32_t*>(mesh.triangles.data());
  const auto* const primitives = reinterpret_cast<const int32_t*>(task.hits.primitive.data());
  float out[10][k_most_double_lanes];
  for (size_t begin = 0; begin < task.count; begin += k_lanes) {
    const size_t used = std::min(task.count - begin, k_lanes);
    int32_t places[k_most_double_lanes];
    // Lanes beyond the last hit repeat it: what follows in the list lies on another mesh.
    for (size_t l = 0; l < k_lanes; ++l) places[l] = task.places[begin + std::min(l, used - 1)];
    const Index_t<D> place = load_indices<D>(places);
    const Index_t<D> primitive = gather_indices<D>(primitives, place);
    const Index_t<D> row = primitive + primitive + primitive;
    const auto corner = [&](int i) { return gather_indices<D>(corners + i, row); };
    const D b1 = gather_floats<D>(task.hits.u.data(), place), b2 = gather_floats<D>(task.hits.v.data(), place);
    const LocalSurface<D> local = mesh_surface<D>(mesh, corner(0), corner(1), corner(2), b1, b2);
    const WorldSurface<D> s = to_world_surface<D>(to_world, to_object, sign, local);
    const D* const values[9] = {&s.position.x, &s.position.y, &s.position.z, &s.normal.x, &s.normal.y,
                                &s.normal.z,   &s.shading.x,  &s.shading.y,  &s.shading.z};
    for (int i = 0; i < 9; ++i) store_floats(*values[i], out[i]);
    store_next_floats(s.error, out[9]);
    for (size_t l = 0; l < used; ++l) {
      const auto at = uint32_t(places[l]);
      SurfacePoint& p = result[at];
      p.position = {out[0][l], out[1][l], out[2][l]};
      p.geometric_normal = {out[3][l], out[4][l], out[5][l]};
      p.shading_normal = {out[6][l], out[7][l], out[8][l]};
      p.error = out[9][l];
      p.instance = task.instance;
      p.primitive = task.hits.primitive[at];
    }
  }
}

FT_LANES_END

#endif  // toggled guard
