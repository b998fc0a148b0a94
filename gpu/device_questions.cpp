// What each kind of question sends, and how its answers are merged as the CPU's kernels merge theirs.
#include "gpu/device_questions.h"

#include <algorithm>

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

struct ConeQuestion : MaskQuestion<ConeMasks> {
  ConeQuestion(const Field& of, const ConeTask& cone_task, const ShadingPointBatch& all, const Sphere& ball,
               std::span<const uint32_t> asked, const int32_t* all_flags)
      : MaskQuestion(of, blocks_with(asked, all_flags, k_may_shadow)),
        task(cone_task),
        points(all),
        light(ball),
        flags(all_flags) {}

  void stage(StagingBuffer& in, StagingBuffer& out) override {
    const AlignedVector<float>* const arrays[] = {&points.px, &points.py, &points.pz,    &points.gx,
                                                  &points.gy, &points.gz, &points.error, &points.radius};
    for (int i = 0; i < 8; ++i) at[i] = stage_blocks(in, arrays[i]->data(), blocks);
    instance_at = stage_blocks(in, points.instance.data(), blocks);
    transmits_at = in.reserve(blocks.size() * k_warp * sizeof(uint32_t));
    uint32_t* to = in.host<uint32_t>(transmits_at);
    for (const uint32_t block : blocks) to = std::copy_n(points.transmits.data() + block, k_warp, to);
    flags_at = stage_blocks(in, flags, blocks);
    stage_masks(out);
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
  StratumQuestion(const Field& of, const StratumTask& stratum_task, const RayBatch& all, const float* density,
                  const float* near, const int32_t* all_wanted, std::span<const uint32_t> asked)
      : MaskQuestion(of, blocks_with(asked, all_wanted, 1)),
        task(stratum_task),
        rays(all),
        pdf(density),
        radius(near),
        wanted(all_wanted) {}

  void stage(StagingBuffer& in, StagingBuffer& out) override {
    staged.stage(in, rays, blocks);
    pdf_at = stage_blocks(in, pdf, blocks);
    radius_at = stage_blocks(in, radius, blocks);
    wanted_at = stage_blocks(in, wanted, blocks);
    clear_at = out.reserve(blocks.size() * k_warp * sizeof(float));
    stage_masks(out);
  }

  Status launch(Runtime& runtime, const FieldView& view, const GpuDevice::Wave& wave) const override {
    StratumArguments a = {task,
                          staged.on_device(wave.in),
                          wave.in.device<const float>(pdf_at),
                          wave.in.device<const float>(radius_at),
                          wave.in.device<const int32_t>(wanted_at),
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
  const RayBatch& rays;
  const float *pdf, *radius;
  const int32_t* wanted;
  StagedRays staged;
  size_t pdf_at = 0, radius_at = 0, wanted_at = 0, clear_at = 0;
  std::vector<float> clear;
};

struct RayQuestion : MaskQuestion<RayMasks> {
  RayQuestion(const Field& of, const SegmentTask& segment_task, const RayBatch& all, const uint32_t* from,
              std::span<const uint32_t> asked)
      : MaskQuestion(of, {asked.begin(), asked.end()}), task(segment_task), rays(all), instance(from) {}

  void stage(StagingBuffer& in, StagingBuffer& out) override {
    staged.stage(in, rays, blocks);
    instance_at = stage_blocks(in, instance, blocks);
    stage_masks(out);
  }

  Status launch(Runtime& runtime, const FieldView& view, const GpuDevice::Wave& wave) const override {
    QueryArguments a = {task,
                        staged.on_device(wave.in),
                        wave.in.device<const uint32_t>(instance_at),
                        wave.out.device<RayMasks>(masks_at),
                        missing_of(*this, wave),
                        uint32_t(blocks.size())};
    a.task.field = view;
    return launch_kernel(runtime, wave, Kernel::query, a);
  }

  const SegmentTask& task;
  const RayBatch& rays;
  const uint32_t* instance;
  StagedRays staged;
  size_t instance_at = 0;
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

uint64_t GpuDevice::filter_strata(const Field& field, const StratumTask& task, const RayBatch& rays, const float* pdf,
                                  const float* radius, const int32_t* wanted, std::span<const uint32_t> blocks,
                                  float* clear, int32_t* refused, ConeUnknowns& unknowns) {
  StratumQuestion q(field, task, rays, pdf, radius, wanted, blocks);
  ask(q);
  const uint64_t lookups =
      cpu_.filter_strata(field, task, rays, pdf, radius, wanted, blocks_left(q), clear, refused, unknowns);
  return lookups + merge_blocks(q, [&](uint32_t block, const StratumMasks& m, size_t warp) {
           for (uint32_t lane = 0; lane < k_warp; ++lane) {
             clear[block + lane] *= q.clear[warp * k_warp + lane];
             if (has_lane(m.refused, lane)) refused[block + lane] = 1;
           }
         });
}

SegmentCounts GpuDevice::query(const Field& field, const SegmentTask& task, const RayBatch& rays,
                               const uint32_t* shading_point_instance, std::span<const uint32_t> blocks,
                               int32_t candidate_slot, RayStates& states) {
  RayQuestion q(field, task, rays, shading_point_instance, blocks);
  ask(q);
  SegmentCounts counts = cpu_.query(field, task, rays, shading_point_instance, blocks_left(q), candidate_slot, states);
  counts.lookups += merge_blocks(q, [&](uint32_t block, const RayMasks& m, size_t) {
    counts.crossings += uint64_t(std::popcount(m.crosses));
    merge_rays(m, block, candidate_slot, states);
  });
  return counts;
}

}  // namespace fieldtrace::gpu
