// The GPU's kernels: a thread for each entry of a block, a warp for each block, the CPU's scalar functions for the
// answers, and ballots for the masks. No shared memory, no atomics, no order among warps (gpu/device_arguments.h).
//
// Compiled without contraction (gpu/CMakeLists.txt), so that answers are the CPU's, bit for bit. Launched with one warp
// a thread block and a thread block for each of the arguments' `warps`.
#include "core/light/light_environment.hd.h"
#include "core/light/light_ray.hd.h"
#include "core/light/light_shapes_area.hd.h"
#include "core/sampling/sobol.hd.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/query/task_answers.hd.h"
#include "gpu/device_arguments.h"

namespace fieldtrace::gpu {
namespace {

constexpr uint32_t k_words_a_lane = k_missing_words / k_warp;

__device__ uint32_t lane_index() { return threadIdx.x; }
__device__ uint32_t entry_index() { return blockIdx.x * k_warp + lane_index(); }
__device__ uint32_t ballot(bool value) { return __ballot_sync(k_all_lanes, value); }

// In every lane: the sum over the warp.
__device__ uint32_t warp_sum(uint32_t value) {
  for (uint32_t step = k_warp / 2; step > 0; step /= 2) value += __shfl_xor_sync(k_all_lanes, value, int(step));
  return value;
}

// What a lane met that is not resident, in its words of `missing`.
class LaneMissing {
 public:
  __device__ explicit LaneMissing(uint32_t* missing) : words_(missing + entry_index() * k_words_a_lane) {}

  __device__ void add(MissingKind kind, int32_t number) {
    if (used_ < k_words_a_lane) words_[used_++] = missing_word(kind, uint32_t(number));
  }
  // The warp's mask: all lanes or none. Must be called by the whole warp.
  __device__ uint32_t finish(bool unknown) {
    if (ballot(unknown) == 0) return 0;
    while (used_ < k_words_a_lane) words_[used_++] = k_nothing;
    return k_all_lanes;
  }

 private:
  uint32_t* words_;
  uint32_t used_ = 0;
};

// Called by look-ups with what is not baked.
struct TellMissing {
  LaneMissing& list;
  MissingKind kind;
  __device__ void operator()(int32_t number, bool missing) const {
    if (missing) list.add(kind, number);
  }
};

using scalar::Vec3Lanes;

__device__ Vec3Lanes<float> load(const float* x, const float* y, const float* z, uint32_t i) {
  return {x[i], y[i], z[i]};
}

}  // namespace

// The lane's entry of the arrays that the wave's questions share.
__device__ uint32_t block_entry(const uint32_t* blocks) { return blocks[blockIdx.x] + lane_index(); }
// Of masks for each 32 entries, of which the first of a block is a multiple.
__device__ bool has_bit(uint32_t mask) { return (mask >> lane_index() & 1u) != 0; }

extern "C" __global__ void __launch_bounds__(k_warp) light_cones(const __grid_constant__ ConeArguments a) {
  const uint32_t i = block_entry(a.blocks);
  const PointArrays& r = a.points;
  const bool queried = has_bit(a.wanted[blockIdx.x]);
  LaneMissing missing(a.missing);
  scalar::PointAnswer<float> answer = {{false, false, false, 0}, false};
  if (queried) {
    const scalar::PointLanes<float> point = {load(r.px, r.py, r.pz, i),
                                             load(r.gx, r.gy, r.gz, i),
                                             r.error[i],
                                             r.radius[i],
                                             r.instance[i] == a.task.segment.instance,
                                             !has_bit(r.transmits[i / k_warp])};
    const Vec3Lanes<float> centre = {a.light_centre[0], a.light_centre[1], a.light_centre[2]};
    answer =
        scalar::answer_light<float>(a.task, point, centre, a.light_radius, queried,
                                    TellMissing{missing, MissingKind::tile}, TellMissing{missing, MissingKind::depth});
  }
  const scalar::ConeAnswer<float>& cone = answer.cone;
  ConeMasks m;
  m.clear = ballot(cone.clear);
  m.blocked = ballot(cone.blocked);
  m.by_strata = ballot(answer.by_strata && !cone.clear && !cone.blocked);
  m.not_baked = missing.finish(cone.unknown);
  m.lookups = warp_sum(uint32_t(cone.lookups));
  if (lane_index() == 0) a.masks[blockIdx.x] = m;
}

extern "C" __global__ void __launch_bounds__(k_warp) filter_strata(const __grid_constant__ StratumArguments a) {
  const uint32_t i = block_entry(a.blocks);
  const RayArrays& r = a.rays;
  const float tmax = r.tmax[i];
  const bool queried = has_bit(a.wanted[blockIdx.x]) && tmax >= 0.0f;
  LaneMissing missing(a.missing);
  scalar::StratumAnswer<float> answer = {1.0f, false, false, 0};
  if (queried) {
    answer = scalar::answer_stratum<float>(a.task, load(r.ox, r.oy, r.oz, i), load(r.dx, r.dy, r.dz, i), tmax, a.pdf[i],
                                           a.radius[i], queried, TellMissing{missing, MissingKind::tile});
  }
  a.clear[entry_index()] = answer.clear;
  ShareMasks m;
  m.refused = ballot(answer.refused);
  m.not_baked = missing.finish(answer.unknown);
  m.lookups = warp_sum(uint32_t(answer.lookups));
  if (lane_index() == 0) a.masks[blockIdx.x] = m;
}

extern "C" __global__ void __launch_bounds__(k_warp) query(const __grid_constant__ QueryArguments a) {
  const uint32_t i = block_entry(a.blocks);
  const RayArrays& r = a.rays;
  LaneMissing missing(a.missing);
  const scalar::SegmentVerdict<float> answer = scalar::answer_segment<float>(
      a.task, load(r.ox, r.oy, r.oz, i), load(r.dx, r.dy, r.dz, i), r.tmax[i], a.instance[i] == a.task.instance);
  const int32_t verdict = answer.verdict;
  TellMissing{missing, MissingKind::visibility}(answer.slice, verdict == scalar::k_verdict_unknown_visibility);
  TellMissing{missing, MissingKind::depth}(answer.slice, verdict == scalar::k_verdict_unknown_depth);
  RayMasks m;
  m.crosses = ballot(verdict != scalar::k_verdict_none);
  m.blocked = ballot(verdict == scalar::k_verdict_blocked);
  m.undecided = ballot(verdict == scalar::k_verdict_undecided);
  m.not_baked = missing.finish(verdict > scalar::k_verdict_undecided);
  m.lookups = warp_sum(uint32_t(answer.lookups));
  if (lane_index() == 0) a.masks[blockIdx.x] = m;
}

extern "C" __global__ void __launch_bounds__(k_warp) filter_lobes(const __grid_constant__ LobeArguments a) {
  const uint32_t i = block_entry(a.blocks), to = entry_index();
  const LobeArrays& l = a.lobes;
  const RayArrays& r = l.rays;
  LaneMissing missing(a.missing);
  const scalar::LobeLanes<float> lobe =
      scalar::make_lobe<float>(a.task, load(r.ox, r.oy, r.oz, i), load(r.dx, r.dy, r.dz, i), r.tmax[i], l.density[i]);
  const scalar::LobeAnswer<float> answer =
      scalar::answer_lobe<float>(a.task, lobe, load(l.nx, l.ny, l.nz, i), l.instance[i] == a.task.segment.instance,
                                 l.blur[i], TellMissing{missing, MissingKind::tile});
  a.clear[to] = answer.clear;
  a.red[to] = answer.radiance.red, a.green[to] = answer.radiance.green, a.blue[to] = answer.radiance.blue;
  a.distance[to] = answer.distance;
  ShareMasks m;
  m.refused = ballot(answer.refused);
  m.not_baked = missing.finish(answer.unknown);
  m.lookups = warp_sum(uint32_t(answer.lookups));
  if (lane_index() == 0) a.masks[blockIdx.x] = m;
}

namespace {

// The ray of sample k from shading point r.
template <class Kind, bool k_transmits>
__device__ void make_ray(const LightRayArguments& a, const Kind& kind, uint32_t r, uint32_t k, uint32_t to) {
  const ReceiverArrays& p = a.receivers;
  const uint32_t dimension = k_light_dimension + 2 * a.light_index;
  const float transmits = float(p.transmits[r / k_warp] >> (r % k_warp) & 1u);
  const scalar::ShadingPointInput<float> in = {load(p.px, p.py, p.pz, r),
                                               load(p.gx, p.gy, p.gz, r),
                                               load(p.sx, p.sy, p.sz, r),
                                               p.error[r],
                                               transmits,
                                               p.seed[r],
                                               p.sample[r],
                                               p.instance[r]};
  const auto point = scalar::shading_point_lanes<float, Kind, k_transmits>(a.light, dimension,
                                                                           scalar::set_stream(dimension), a.range, in);
  const auto at = scalar::light_sample_point<float, Kind>(a.range, a.tables.point_sets, point, k);
  const auto ray = scalar::light_ray<float, Kind, k_transmits>(kind, point, kind.setup(point.at), at.point, at.third);
  const scalar::StoredRay<float> stored = scalar::stored_ray<float, Kind>(ray, ray.active);
  a.ox[to] = ray.origin.x, a.oy[to] = ray.origin.y, a.oz[to] = ray.origin.z;
  a.dx[to] = stored.d.x, a.dy[to] = stored.d.y, a.dz[to] = stored.d.z;
  a.tmax[to] = stored.tmax;
  a.pdf[to] = stored.pdf;
}

__device__ void make_inactive(const LightRayArguments& a, uint32_t to) {
  a.ox[to] = a.oy[to] = a.oz[to] = a.dx[to] = a.dy[to] = a.pdf[to] = 0.0f;
  a.dz[to] = 1.0f;
  a.tmax[to] = -1.0f;
}

template <class Kind, class... Tables>
__device__ void make_ray(const LightRayArguments& a, uint32_t r, uint32_t k, uint32_t to, const Tables*... tables) {
  const Kind kind(a.light, tables...);
  if (a.any_transmits) {
    make_ray<Kind, true>(a, kind, r, k, to);
  } else {
    make_ray<Kind, false>(a, kind, r, k, to);
  }
}

__device__ void make_ray_of_kind(const LightRayArguments& a, uint32_t r, uint32_t k, uint32_t to) {
  switch (a.light.kind) {
    case LightKind::none:
      return make_inactive(a, to);
    case LightKind::sphere:
      return make_ray<scalar::SphereLight<float>>(a, r, k, to);
    case LightKind::sphere_inside:
    case LightKind::ellipsoid:
      return make_ray<scalar::EllipsoidLight<float>>(a, r, k, to);
    case LightKind::rectangle:
      return make_ray<scalar::RectangleLight<float>>(a, r, k, to);
    case LightKind::parallelogram:
      return make_ray<scalar::ParallelogramLight<float>>(a, r, k, to);
    case LightKind::disk:
      return make_ray<scalar::DiskLight<float>>(a, r, k, to);
    case LightKind::cylinder:
      return make_ray<scalar::CylinderLight<float>>(a, r, k, to);
    case LightKind::mesh:
      return make_ray<scalar::MeshLight<float>>(a, r, k, to, a.tables.triangles);
    case LightKind::point:
      return make_ray<scalar::PointLight<float>>(a, r, k, to);
    case LightKind::directional:
      return make_ray<scalar::DirectionalLight<float>>(a, r, k, to);
    case LightKind::constant:
      return make_ray<scalar::ConstantLight<float>>(a, r, k, to);
    case LightKind::environment:
      return make_ray<scalar::EnvironmentLight<float>>(a, r, k, to, a.tables.rows, a.tables.sums, a.tables.texels);
  }
}

}  // namespace

extern "C" __global__ void __launch_bounds__(k_warp) light_rays(const __grid_constant__ LightRayArguments a) {
  const LightRayBlock block = a.blocks[blockIdx.x];
  const uint32_t place = block.first + lane_index(), to = entry_index();
  if (place >= block.slots) {
    make_inactive(a, to);
    a.radius[to] = 0.0f;
    a.instance[to] = 0xffffffffu;
    return;
  }
  const uint32_t slot = a.numbers ? a.numbers[to] : place, count = uint32_t(a.range.count);
  const uint32_t r = block.point + slot / count;
  make_ray_of_kind(a, r, slot % count, to);
  a.radius[to] = a.receivers.radius[r];
  a.instance[to] = a.receivers.instance[r];
}

// Its arrays of parallelograms lie in local memory. At least 8 warps a multiprocessor: else the compiler spills on
// sm_75.
extern "C" __global__ void __launch_bounds__(k_warp, 8) sky_cells(const __grid_constant__ SkyArguments a) {
  const uint32_t i = entry_index();
  const SkyBlock block = a.blocks[blockIdx.x];
  const CellPoints& in = a.points;
  const Vec3Lanes<float> p = load(in.px, in.py, in.pz, i), g = load(in.gx, in.gy, in.gz, i),
                         s = load(in.sx, in.sy, in.sz, i);
  Vec3Lanes<float> taken = {0.0f, 0.0f, 0.0f}, reflected = taken;
  for (uint32_t k = 0; k < block.cells; ++k) {
    const CellTask& task = a.tasks[block.first_task + k];
    const float cosine = scalar::cosine_of<float>(task, s);
    bool open = false;
    if (cosine > 0.0f) {
      const scalar::CellTaken<float> of_cell = scalar::take_cell<float>(task, block.grazing, p, g, s, cosine);
      taken = taken + of_cell.irradiance;
      if (task.reflects) reflected = reflected + of_cell.reflected;
      open = of_cell.open;
    }
    const uint32_t mask = ballot(open);
    if (lane_index() == 0) a.undecided[block.undecided + k] = mask;
  }
  a.sums.red[i] = taken.x, a.sums.green[i] = taken.y, a.sums.blue[i] = taken.z;
  a.sums.reflected_red[i] = reflected.x, a.sums.reflected_green[i] = reflected.y;
  a.sums.reflected_blue[i] = reflected.z;
}

extern "C" __global__ void __launch_bounds__(k_warp) scatter(const __grid_constant__ ScatterArguments a) {
  const ScatterRun run = a.runs[blockIdx.x];
  uint32_t* const to = reinterpret_cast<uint32_t*>(run.to);
  for (uint32_t w = lane_index(); w < run.words; w += k_warp) to[w] = a.packet[run.from + w];
}

}  // namespace fieldtrace::gpu
