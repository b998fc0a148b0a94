// What each kind of question sends, and how its answers are merged as the CPU's kernels merge theirs.
#include "gpu/device_questions.h"

#include <algorithm>
#include <cstddef>
#include <map>

#include "core/light/light_sampling.h"
#include "field/query/query.hd.h"

namespace fieldtrace::gpu {
namespace {

template <class Arguments>
Status launch_kernel(Runtime& runtime, const GpuDevice::Wave& wave, Kernel kernel, const Arguments& arguments) {
  return runtime.launch(wave.stream, kernel, arguments.warps, &arguments, sizeof arguments);
}

uint32_t* missing_of(const GpuDevice::Question& q, const GpuDevice::Wave& wave) {
  return wave.missing.device<uint32_t>(q.missing);
}

bool has_lane(uint32_t mask, uint32_t lane) { return (mask >> lane & 1u) != 0; }

// The blocks in which any entry of `values` has `bit`.
std::vector<uint32_t> blocks_with(std::span<const uint32_t> blocks, const int32_t* values, int32_t bit) {
  std::vector<uint32_t> chosen;
  for (const uint32_t block : blocks) {
    const bool any = std::any_of(values + block, values + block + k_warp, [&](int32_t v) { return (v & bit) != 0; });
    if (any) chosen.push_back(block);
  }
  return chosen;
}

// Whether the kernel light_rays knows the light's kind: it has no tables of triangles or skies.
bool needs_no_table(LightKind kind) {
  return kind != LightKind::none && kind != LightKind::mesh && kind != LightKind::environment;
}

constexpr size_t k_word = sizeof(uint32_t);

// Whether rays are made on the device: what goes up is less then.
bool sends_points(const LightRaySource& source, size_t words_a_ray, size_t blocks) {
  if (!source.lights || !needs_no_table(source.lights->lights[source.light].kind)) return false;
  const ShadingPointBatch& points = *source.points;
  constexpr size_t k_words_a_point = sizeof(ReceiverArrays) / sizeof(void*);
  if (points.size * k_words_a_point + blocks >= blocks * k_warp * words_a_ray) return false;
  return std::none_of(points.transmits.begin(), points.transmits.begin() + std::ptrdiff_t(points.size),
                      [](uint8_t t) { return t != 0; });
}

size_t words_a_ray(const StagedRays::Others& o) {
  return 7 + (o.pdf != nullptr) + (o.radius != nullptr) + (o.wanted != nullptr) + (o.instance != nullptr);
}

// Of values for each ray, the first of each shading point's.
template <class T>
size_t stage_firsts(StagingBuffer& in, const T* of_rays, size_t points, size_t count) {
  const size_t at = in.reserve(points * sizeof(T));
  T* const to = in.host<T>(at);
  for (size_t r = 0; r < points; ++r) to[r] = of_rays[r * count];
  return at;
}

struct ConeQuestion : MaskQuestion<ConeMasks> {
  ConeQuestion(const Field& of, const ConeTask& cone_task, const ShadingPointBatch& all, const Sphere& ball,
               std::span<const uint32_t> asked, const int32_t* all_flags)
      : MaskQuestion(&of, blocks_with(asked, all_flags, k_may_shadow)),
        task(cone_task),
        points(all),
        light(ball),
        flags(all_flags) {}

  void stage(GpuDevice::Wave& wave) override {
    StagingBuffer& in = wave.in;
    const AlignedVector<float>* const arrays[] = {&points.px, &points.py, &points.pz,    &points.gx,
                                                  &points.gy, &points.gz, &points.error, &points.radius};
    for (int i = 0; i < 8; ++i) at[i] = stage_blocks(in, arrays[i]->data(), blocks);
    instance_at = stage_blocks(in, points.instance.data(), blocks);
    transmits_at = in.reserve(blocks.size() * k_warp * sizeof(uint32_t));
    uint32_t* to = in.host<uint32_t>(transmits_at);
    for (const uint32_t block : blocks) to = std::copy_n(points.transmits.data() + block, k_warp, to);
    flags_at = stage_blocks(in, flags, blocks);
    stage_masks(wave.out);
  }

  Status launch(Runtime& runtime, const FieldView& view, const GpuDevice::Wave& wave) const override {
    const auto array = [&](int i) { return wave.in.device<const float>(at[i]); };
    ConeArguments a = {task,
                       {light.centre.x, light.centre.y, light.centre.z},
                       light.radius,
                       {array(0), array(1), array(2), array(3), array(4), array(5), array(6), array(7),
                        wave.in.device<const uint32_t>(instance_at), wave.in.device<const uint32_t>(transmits_at)},
                       wave.in.device<const int32_t>(flags_at),
                       wave.out.device<ConeMasks>(masks_at),
                       missing_of(*this, wave),
                       uint32_t(blocks.size())};
    a.task.segment.field = view;
    return launch_kernel(runtime, wave, Kernel::light_cones, a);
  }

  const ConeTask& task;
  const ShadingPointBatch& points;
  const Sphere& light;
  const int32_t* flags;
  size_t at[8], instance_at = 0, transmits_at = 0, flags_at = 0;
};

struct StratumQuestion : MaskQuestion<StratumMasks> {
  StratumQuestion(const Field& of, const StratumTask& stratum_task, const RayBatch& all, const LightRaySource& source,
                  const StagedRays::Others& others, std::span<const uint32_t> asked)
      : MaskQuestion(&of, blocks_with(asked, others.wanted, 1)),
        task(stratum_task),
        rays(all, source, others, blocks) {}

  void list(std::vector<Table>& tables) const override { rays.list(tables); }
  void stage(GpuDevice::Wave& wave) override {
    rays.stage(wave);
    clear_at = wave.out.reserve(blocks.size() * k_warp * sizeof(float));
    stage_masks(wave.out);
  }

  Status launch(Runtime& runtime, const FieldView& view, const GpuDevice::Wave& wave) const override {
    const Status status = rays.launch(runtime, wave);
    if (status != k_success) return status;
    StratumArguments a = {task,
                          rays.arrays(wave),
                          rays.pdf(wave),
                          rays.radius(wave),
                          rays.wanted(wave),
                          wave.out.device<float>(clear_at),
                          wave.out.device<StratumMasks>(masks_at),
                          missing_of(*this, wave),
                          uint32_t(blocks.size())};
    a.task.segment.field = view;
    return launch_kernel(runtime, wave, Kernel::filter_strata, a);
  }

  void take_answers(const StagingBuffer& out) override {
    MaskQuestion::take_answers(out);
    const float* from = out.host<float>(clear_at);
    clear.assign(from, from + blocks.size() * k_warp);
  }

  const StratumTask& task;
  StagedRays rays;
  size_t clear_at = 0;
  std::vector<float> clear;
};

struct RayQuestion : MaskQuestion<RayMasks> {
  RayQuestion(const Field& of, const SegmentTask& segment_task, const RayBatch& all, const LightRaySource& source,
              const uint32_t* instance, std::span<const uint32_t> asked)
      : MaskQuestion(&of, {asked.begin(), asked.end()}),
        task(segment_task),
        rays(all, source, {.instance = instance}, blocks) {}

  void list(std::vector<Table>& tables) const override { rays.list(tables); }
  void stage(GpuDevice::Wave& wave) override {
    rays.stage(wave);
    stage_masks(wave.out);
  }

  Status launch(Runtime& runtime, const FieldView& view, const GpuDevice::Wave& wave) const override {
    const Status status = rays.launch(runtime, wave);
    if (status != k_success) return status;
    QueryArguments a = {task,
                        rays.arrays(wave),
                        rays.instance(wave),
                        wave.out.device<RayMasks>(masks_at),
                        missing_of(*this, wave),
                        uint32_t(blocks.size())};
    a.task.field = view;
    return launch_kernel(runtime, wave, Kernel::query, a);
  }

  const SegmentTask& task;
  StagedRays rays;
};

// Cells of a sky for a batch of points: tasks and what they refer to as one copy, whose pointers are made the device's.
struct SkyQuestion : GpuDevice::Question {
  SkyQuestion(std::span<const CellTask> cells, const CellPoints& of, std::vector<uint32_t> asked)
      : Question(nullptr, std::move(asked)), tasks(cells), points(of) {
    for (const CellTask& task : tasks) look_at(task);
  }

  void list(std::vector<Table>& tables) const override {
    for (const auto& [view, at] : maps) {
      tables.push_back({view->depth, size_t(view->depth_bytes) * size_t(view->directions)});
      tables.push_back({view->coverage, size_t(view->coverage_bytes) * size_t(view->directions)});
    }
    for (const auto& [view, at] : radiance) tables.push_back({view->words, size_t(view->bytes) * size_t(view->count)});
  }

  void stage(GpuDevice::Wave& wave) override {
    for (auto& [view, at] : maps) {
      MapsView copy = *view;
      copy.depth = wave.tables.at<const uint8_t>(view->depth);
      copy.coverage = wave.tables.at<const uint8_t>(view->coverage);
      at = wave.in.append(&copy, sizeof copy);
    }
    for (auto& [view, at] : radiance) {
      RadianceView copy = *view;
      copy.words = wave.tables.at<const uint8_t>(view->words);
      at = wave.in.append(&copy, sizeof copy);
    }
    pointers.clear();
    for (auto& [plane, at] : planes) {
      PlaneRadiance copy = *plane;
      at = wave.in.append(&copy, sizeof copy);
      point(wave.in, at + offsetof(PlaneRadiance, view), radiance[plane->view]);
    }
    tasks_at = wave.in.append(tasks.data(), tasks.size_bytes());
    for (size_t k = 0; k < tasks.size(); ++k) stage_task(wave.in, tasks[k], tasks_at + k * sizeof(CellTask));
    const float* const arrays[] = {points.px, points.py, points.pz, points.gx, points.gy,
                                   points.gz, points.sx, points.sy, points.sz};
    for (int i = 0; i < 9; ++i) points_at[i] = wave.in.append(arrays[i], size_t(points.size) * sizeof(float));
    sums_at = wave.out.reserve(6 * size_t(points.size) * sizeof(float));
    masks_at = wave.out.reserve(blocks.size() * tasks.size() * sizeof(uint32_t));
  }

  void settle(GpuDevice::Wave& wave) override {
    for (const auto& [from, to] : pointers) *wave.in.host<const void*>(from) = wave.in.device<const std::byte>(to);
  }

  Status launch(Runtime& runtime, const FieldView&, const GpuDevice::Wave& wave) const override {
    const auto in = [&](int i) { return wave.in.device<const float>(points_at[i]); };
    const auto sum = [&](int i) { return wave.out.device<float>(sums_at) + i * points.size; };
    const SkyArguments a = {
        wave.in.device<const CellTask>(tasks_at),
        uint32_t(tasks.size()),
        {in(0), in(1), in(2), in(3), in(4), in(5), in(6), in(7), in(8), points.size, points.grazing},
        {sum(0), sum(1), sum(2), sum(3), sum(4), sum(5)},
        wave.out.device<uint32_t>(masks_at),
        uint32_t(blocks.size())};
    return launch_kernel(runtime, wave, Kernel::sky_cells, a);
  }

  void take_answers(const StagingBuffer& out) override {
    const float* const from = out.host<float>(sums_at);
    sums.assign(from, from + 6 * size_t(points.size));
    const uint32_t* const words = out.host<uint32_t>(masks_at);
    masks.assign(words, words + blocks.size() * tasks.size());
  }
  bool not_baked(size_t) const override { return false; }

  // Notes the tables of a task.
  void look_at(const CellTask& task) {
    const auto add = [](auto& places, const auto* p) {
      if (p) places[p] = 0;
    };
    if (task.own) add(maps, task.own->lines.maps);
    for (int k = 0; k < task.map_count; ++k) add(maps, task.maps[k].maps);
    if (task.own_radiance) add(radiance, task.own_radiance->view);
    for (int k = 0; task.map_radiance && task.reflects && k < task.map_count; ++k) {
      add(radiance, task.map_radiance[k].view);
    }
    for (int k = 0; k < task.plane_count; ++k) {
      add(planes, task.planes[k].radiance);
      if (task.planes[k].radiance) add(radiance, task.planes[k].radiance->view);
    }
  }

  // The pointer at `from` shall be the place `to` on the device.
  void point(StagingBuffer& in, size_t from, size_t to) {
    *in.host<const void*>(from) = nullptr;
    pointers.emplace_back(from, to);
  }
  template <class T, class Place>
  void point_to(StagingBuffer& in, size_t from, const T* table, const Place& places) {
    if (table) point(in, from, places.at(table));
  }

  void stage_task(StagingBuffer& in, const CellTask& task, size_t at) {
    if (task.own) {
      const size_t own = in.append(task.own, sizeof *task.own);
      point_to(in, own + offsetof(OwnLines, lines) + offsetof(MapLines, maps), task.own->lines.maps, maps);
      point(in, at + offsetof(CellTask, own), own);
    }
    if (task.own_radiance) {
      const size_t own = in.append(task.own_radiance, sizeof *task.own_radiance);
      point_to(in, own + offsetof(MapRadiance, view), task.own_radiance->view, radiance);
      point(in, at + offsetof(CellTask, own_radiance), own);
    }
    const size_t lines = in.append(task.maps, size_t(task.map_count) * sizeof(MapLines));
    const bool reflects = task.reflects && task.map_radiance;
    const size_t back = in.append(task.map_radiance, reflects ? size_t(task.map_count) * sizeof(MapRadiance) : 0);
    for (int k = 0; k < task.map_count; ++k) {
      const size_t i = size_t(k);
      point_to(in, lines + i * sizeof(MapLines) + offsetof(MapLines, maps), task.maps[k].maps, maps);
      if (!reflects) continue;
      point_to(in, back + i * sizeof(MapRadiance) + offsetof(MapRadiance, view), task.map_radiance[k].view, radiance);
    }
    const size_t plane = in.append(task.planes, size_t(task.plane_count) * sizeof(PlaneLines));
    for (int k = 0; k < task.plane_count; ++k) {
      point_to(in, plane + size_t(k) * sizeof(PlaneLines) + offsetof(PlaneLines, radiance), task.planes[k].radiance,
               planes);
    }
    point(in, at + offsetof(CellTask, maps), lines);
    point(in, at + offsetof(CellTask, map_radiance), back);
    point(in, at + offsetof(CellTask, planes), plane);
    point(in, at + offsetof(CellTask, balls), in.append(task.balls, size_t(task.ball_count) * sizeof(BallLines)));
  }

  const std::span<const CellTask> tasks;
  const CellPoints& points;
  // Places in the wave's `in`.
  std::map<const MapsView*, size_t> maps;
  std::map<const RadianceView*, size_t> radiance;
  std::map<const PlaneRadiance*, size_t> planes;
  std::vector<std::pair<size_t, size_t>> pointers;
  size_t tasks_at = 0, points_at[9], sums_at = 0, masks_at = 0;
  std::vector<float> sums;
  std::vector<uint32_t> masks;
};

// The blocks that the device left to the CPU.
template <class Masks>
std::vector<uint32_t> blocks_left(const MaskQuestion<Masks>& q) {
  if (!q.is_answered) return q.blocks;
  std::vector<uint32_t> left;
  for (size_t warp = 0; warp < q.blocks.size(); ++warp) {
    if (q.not_baked(warp)) left.push_back(q.blocks[warp]);
  }
  return left;
}

// Calls merge(first entry, masks, warp) for each block that the device answered; returns its look-ups.
template <class Masks, class Merge>
uint64_t merge_blocks(const MaskQuestion<Masks>& q, const Merge& merge) {
  uint64_t lookups = 0;
  if (!q.is_answered) return 0;
  for (size_t warp = 0; warp < q.blocks.size(); ++warp) {
    if (q.not_baked(warp)) continue;
    lookups += q.masks[warp].lookups;
    merge(q.blocks[warp], q.masks[warp], warp);
  }
  return lookups;
}

void merge_rays(const RayMasks& m, uint32_t block, int32_t candidate_slot, RayStates& states) {
  for (uint32_t lane = 0; lane < k_warp; ++lane) {
    const uint32_t i = block + lane;
    const bool crosses = has_lane(m.crosses, lane), blocked = has_lane(m.blocked, lane);
    const bool undecided = has_lane(m.undecided, lane);
    if (states.keep_verdicts) {
      states.verdict[i] = !crosses    ? scalar::k_verdict_none
                          : blocked   ? scalar::k_verdict_blocked
                          : undecided ? scalar::k_verdict_undecided
                                      : scalar::k_verdict_clear;
    }
    if (!crosses) continue;
    states.state[i] |= RayStates::k_crosses | (blocked ? RayStates::k_blocked : 0);
    if (!undecided) continue;
    states.state[i] += RayStates::k_undecided;
    states.undecided_slot[i] = candidate_slot;
  }
}

}  // namespace

StagedRays::StagedRays(const RayBatch& rays, const LightRaySource& source, const Others& others,
                       std::span<const uint32_t> blocks)
    : rays_(rays),
      source_(source),
      others_(others),
      blocks_(blocks),
      is_made_(sends_points(source, words_a_ray(others), blocks.size())) {}

void StagedRays::list(std::vector<GpuDevice::Question::Table>& tables) const {
  if (!is_made_ || source_.range.columns > 0) return;
  const auto& sets = source_.lights->point_sets;
  tables.push_back({sets.data(), sets.size() * sizeof(int32_t)});
}

void StagedRays::stage_points(StagingBuffer& in) {
  const ShadingPointBatch& p = *source_.points;
  const size_t count = size_t(source_.range.count);
  const AlignedVector<float>* const floats[] = {&p.px, &p.py, &p.pz, &p.gx, &p.gy,
                                                &p.gz, &p.sx, &p.sy, &p.sz, &p.error};
  size_t* at = points_at_;
  for (const AlignedVector<float>* array : floats) *at++ = in.append(array->data(), p.size * k_word);
  *at++ = others_.radius ? stage_firsts(in, others_.radius, p.size, count) : 0;
  for (const auto* array : {&p.seed, &p.sample, &p.instance}) *at++ = in.append(array->data(), p.size * k_word);
  *at = others_.wanted ? stage_firsts(in, others_.wanted, p.size, count) : 0;
  blocks_at_ = in.append(blocks_.data(), blocks_.size_bytes());
}

void StagedRays::stage(GpuDevice::Wave& wave) {
  if (is_made_) {
    stage_points(wave.in);
    const size_t bytes = blocks_.size() * k_warp * k_word;
    for (size_t& at : at_) at = wave.made.reserve(bytes);
    for (size_t* at : {&pdf_at_, &radius_at_, &wanted_at_, &instance_at_}) *at = wave.made.reserve(bytes);
    return;
  }
  const AlignedVector<float>* const arrays[] = {&rays_.ox, &rays_.oy, &rays_.oz,  &rays_.dx,
                                                &rays_.dy, &rays_.dz, &rays_.tmax};
  for (int i = 0; i < 7; ++i) at_[i] = stage_blocks(wave.in, arrays[i]->data(), blocks_);
  if (others_.pdf) pdf_at_ = stage_blocks(wave.in, others_.pdf, blocks_);
  if (others_.radius) radius_at_ = stage_blocks(wave.in, others_.radius, blocks_);
  if (others_.wanted) wanted_at_ = stage_blocks(wave.in, others_.wanted, blocks_);
  if (others_.instance) instance_at_ = stage_blocks(wave.in, others_.instance, blocks_);
}

RayArrays StagedRays::arrays(const GpuDevice::Wave& wave) const {
  const auto array = [&](int i) { return place<const float>(wave, at_[i]); };
  return {array(0), array(1), array(2), array(3), array(4), array(5), array(6)};
}

Status StagedRays::launch(Runtime& runtime, const GpuDevice::Wave& wave) const {
  if (!is_made_) return k_success;
  const auto in = [&](int i) { return wave.in.device<const float>(points_at_[i]); };
  const auto words = [&](int i) { return wave.in.device<const uint32_t>(points_at_[i]); };
  const auto made = [&](int i) { return wave.made.device<float>(at_[i]); };
  const LightRayArguments a = {
      source_.lights->lights[source_.light],
      source_.light,
      source_.range,
      {in(0), in(1), in(2), in(3), in(4), in(5), in(6), in(7), in(8), in(9), in(10), words(11), words(12), words(13),
       wave.in.device<const int32_t>(points_at_[14])},
      uint32_t(rays_.size),
      source_.range.columns > 0 ? nullptr : wave.tables.at<const int32_t>(source_.lights->point_sets.data()),
      wave.in.device<const uint32_t>(blocks_at_),
      made(0),
      made(1),
      made(2),
      made(3),
      made(4),
      made(5),
      made(6),
      others_.pdf ? wave.made.device<float>(pdf_at_) : nullptr,
      others_.radius ? wave.made.device<float>(radius_at_) : nullptr,
      others_.wanted ? wave.made.device<int32_t>(wanted_at_) : nullptr,
      others_.instance ? wave.made.device<uint32_t>(instance_at_) : nullptr,
      uint32_t(blocks_.size())};
  return launch_kernel(runtime, wave, Kernel::light_rays, a);
}

ConeCounts GpuDevice::light_cones(const Field& field, const ConeTask& task, const ShadingPointBatch& points,
                                  const Sphere& light, std::span<const uint32_t> blocks, int32_t* flags,
                                  ConeUnknowns& unknowns) {
  ConeQuestion q(field, task, points, light, blocks, flags);
  ask(q);
  ConeCounts counts = cpu_.light_cones(field, task, points, light, blocks_left(q), flags, unknowns);
  counts.lookups += merge_blocks(q, [&](uint32_t block, const ConeMasks& m, size_t) {
    counts.clear += uint64_t(std::popcount(m.clear));
    counts.blocked += uint64_t(std::popcount(m.blocked));
    for (uint32_t lane = 0; lane < k_warp; ++lane) {
      int32_t& flag = flags[block + lane];
      if (has_lane(m.by_strata, lane)) flag |= k_by_strata;
      if (has_lane(m.clear, lane)) flag = 0;
      if (has_lane(m.blocked, lane)) flag = k_light_blocked;
    }
  });
  return counts;
}

uint64_t GpuDevice::filter_strata(const Field& field, const StratumTask& task, const RayBatch& rays,
                                  const LightRaySource& source, const float* pdf, const float* radius,
                                  const int32_t* wanted, std::span<const uint32_t> blocks, float* clear,
                                  int32_t* refused, ConeUnknowns& unknowns) {
  StratumQuestion q(field, task, rays, source, {.pdf = pdf, .radius = radius, .wanted = wanted}, blocks);
  ask(q);
  const uint64_t lookups =
      cpu_.filter_strata(field, task, rays, source, pdf, radius, wanted, blocks_left(q), clear, refused, unknowns);
  return lookups + merge_blocks(q, [&](uint32_t block, const StratumMasks& m, size_t warp) {
           for (uint32_t lane = 0; lane < k_warp; ++lane) {
             clear[block + lane] *= q.clear[warp * k_warp + lane];
             if (has_lane(m.refused, lane)) refused[block + lane] = 1;
           }
         });
}

SegmentCounts GpuDevice::query(const Field& field, const SegmentTask& task, const RayBatch& rays,
                               const LightRaySource& source, const uint32_t* shading_point_instance,
                               std::span<const uint32_t> blocks, int32_t candidate_slot, RayStates& states) {
  RayQuestion q(field, task, rays, source, shading_point_instance, blocks);
  ask(q);
  SegmentCounts counts =
      cpu_.query(field, task, rays, source, shading_point_instance, blocks_left(q), candidate_slot, states);
  counts.lookups += merge_blocks(q, [&](uint32_t block, const RayMasks& m, size_t) {
    counts.crossings += uint64_t(std::popcount(m.crosses));
    merge_rays(m, block, candidate_slot, states);
  });
  return counts;
}

bool GpuDevice::see_cells(std::span<const CellTask> tasks, const CellPoints& points, const CellSums& sums,
                          std::span<uint32_t> undecided) {
  std::vector<uint32_t> blocks;
  for (uint32_t i = 0; i < uint32_t(points.size); i += k_warp) blocks.push_back(i);
  SkyQuestion q(tasks, points, std::move(blocks));
  ask(q);
  if (!q.is_answered) return false;
  float* const to[] = {sums.red, sums.green, sums.blue, sums.reflected_red, sums.reflected_green, sums.reflected_blue};
  for (size_t i = 0; i < 6; ++i) std::copy_n(q.sums.data() + i * size_t(points.size), points.size, to[i]);
  std::copy(q.masks.begin(), q.masks.end(), undecided.begin());
  return true;
}

}  // namespace fieldtrace::gpu
