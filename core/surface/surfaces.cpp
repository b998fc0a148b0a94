#include "core/surface/surfaces.h"

#include <algorithm>
#include <limits>

#include "core/surface/surface_kernels.h"

namespace fieldtrace {
namespace {

// The kernels' offsets, three per row, are 32 bits wide.
bool fits_kernels(const TriangleMesh& mesh) {
  constexpr size_t k_most_rows = size_t(std::numeric_limits<int32_t>::max()) / 3;
  return std::max(mesh.triangles.size(), mesh.positions.size()) <= k_most_rows;
}

}  // namespace

Surfaces::Surfaces(const Scene& scene, const MaterialTable& materials, Isa isa)
    : scene_(scene), materials_(materials), isa_(resolve_isa(isa)), group_size_(scene.instances.size(), 0) {}

// Counting sort: fills met_ and places_, and leaves in group_size_ the ends of the groups in places_. Neighbouring rays
// mostly hit the same instance, so whole runs are counted and moved.
void Surfaces::group_by_instance(const HitBatch& hits, std::span<const uint32_t> indices) {
  const auto each_run = [&](const auto& call) {
    for (size_t begin = 0, end; begin < indices.size(); begin = end) {
      const uint32_t instance = hits.instance[indices[begin]];
      for (end = begin + 1; end < indices.size() && hits.instance[indices[end]] == instance;) ++end;
      call(instance, indices.subspan(begin, end - begin));
    }
  };
  met_.clear();
  places_.resize(indices.size());
  each_run([&](uint32_t instance, std::span<const uint32_t> run) {
    if (group_size_[instance] == 0) met_.push_back(instance);
    group_size_[instance] += uint32_t(run.size());
  });
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const uint32_t size = group_size_[instance];
    group_size_[instance] = begin;
    begin += size;
  }
  each_run([&](uint32_t instance, std::span<const uint32_t> run) {
    std::copy(run.begin(), run.end(), places_.begin() + group_size_[instance]);
    group_size_[instance] += uint32_t(run.size());
  });
}

void Surfaces::evaluate(const RayBatch& rays, const HitBatch& hits, std::span<const uint32_t> indices) {
  surfaces_.resize(rays.size);
  group_by_instance(hits, indices);
  const SurfaceKernel kernel = surface_kernel_for(isa_);
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const std::span<const int32_t> places(places_.data() + begin, group_size_[instance] - begin);
    begin = group_size_[instance];
    group_size_[instance] = 0;
    const Shape& shape = scene_.shapes[scene_.instances[instance].shape];
    if (!is_meshed(shape.kind) || !fits_kernels(shape.mesh)) {
      for (const int32_t i : places) surfaces_[size_t(i)] = surface_at(scene_, rays, hits, size_t(i));
      continue;
    }
    kernel({scene_, instance, hits, places}, surfaces_.data());
    if (!materials_.varies(scene_.instances[instance].bsdf)) continue;
    for (const int32_t i : places) {
      surfaces_[size_t(i)].uv = triangle_uv(shape, hits.primitive[size_t(i)], hits.u[size_t(i)], hits.v[size_t(i)]);
    }
  }
}

}  // namespace fieldtrace
