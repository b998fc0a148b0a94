#include "core/surface/surfaces.h"

#include <algorithm>
#include <limits>
#include <numeric>

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

void find_runs(const HitBatch& hits, size_t count, std::vector<HitRun>& runs) {
  runs.clear();
  const uint32_t* const instances = hits.instance.data();
  for (uint32_t begin = 0, end = 0; begin < count; begin = end) {
    const uint32_t instance = instances[begin];
    for (end = begin + 1; end < count && instances[end] == instance;) ++end;
    if (instance != k_none) runs.push_back({begin, end});
  }
}

// Counting sort: fills met_ and places_, and leaves in group_size_ the ends of the groups in places_.
void Surfaces::group_by_instance(const HitBatch& hits, std::span<const HitRun> runs) {
  met_.clear();
  size_t total = 0;
  for (const HitRun& run : runs) {
    const uint32_t instance = hits.instance[run.begin];
    if (group_size_[instance] == 0) met_.push_back(instance);
    group_size_[instance] += run.end - run.begin;
    total += run.end - run.begin;
  }
  places_.resize(total);
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const uint32_t size = group_size_[instance];
    group_size_[instance] = begin;
    begin += size;
  }
  for (const HitRun& run : runs) {
    uint32_t& place = group_size_[hits.instance[run.begin]];
    const uint32_t size = run.end - run.begin;
    std::iota(places_.data() + place, places_.data() + place + size, int32_t(run.begin));
    place += size;
  }
}

void Surfaces::evaluate(const RayBatch& rays, const HitBatch& hits, std::span<const HitRun> runs) {
  surfaces_.resize(rays.size);
  group_by_instance(hits, runs);
  const SurfaceKernel kernel = surface_kernel_for(isa_);
  uint32_t begin = 0;
  for (const uint32_t instance : met_) {
    const std::span<const int32_t> places(places_.data() + begin, group_size_[instance] - begin);
    begin = group_size_[instance];
    group_size_[instance] = 0;
    const Shape& shape = scene_.shapes[scene_.instances[instance].shape];
    if (!is_meshed(shape.kind) || !fits_kernels(shape.mesh)) {
      for (const int32_t i : places) surfaces_.set(size_t(i), surface_at(scene_, rays, hits, size_t(i)));
      continue;
    }
    kernel({scene_, instance, hits, places}, surfaces_);
    if (!materials_.varies(scene_.instances[instance].bsdf)) continue;
    for (const int32_t i : places) {
      surfaces_.uv[size_t(i)] = triangle_uv(shape, hits.primitive[size_t(i)], hits.u[size_t(i)], hits.v[size_t(i)]);
    }
  }
}

}  // namespace fieldtrace
