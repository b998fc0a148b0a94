// Lists of groups, whose questions go to a device as one wave: what it answers is merged where the CPU's kernels would
// be asked, group by group. Blocks that met what is not baked are asked about again once it is, but for whole lights:
// which of their points count depends on what the occluders before have settled, and with it what is to be baked; the
// CPU's kernels answer these blocks.

#include <algorithm>

#include "core/platform/parallel.h"
#include "field/bake/bake.h"
#include "field/bake/bake_coverage.h"
#include "hybrid/stats/secondary_timer.h"
#include "hybrid/visibility/device_answers.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

// Calls work(request) for all, in parallel but for those that share their statistics, which must follow one another.
template <class Request, class Work>
void for_each_request(std::span<Request> requests, const Work& work) {
  std::vector<size_t> begins;
  for (size_t i = 0; i < requests.size(); ++i) {
    if (i == 0 || &requests[i].stats != &requests[i - 1].stats) begins.push_back(i);
  }
  if (begins.empty()) return;
  begins.push_back(requests.size());
  parallel_for_isolated(begins.size() - 1, [&](size_t part) {
    const SecondaryTimer timer(requests[begins[part]].stats);
    for (size_t i = begins[part]; i < begins[part + 1]; ++i) work(requests[i]);
  });
}

template <class Question, class Request>
void list_questions(std::span<Request> requests, std::vector<Question*>& list) {
  for (Request& request : requests) {
    for (Question& question : request.questions) {
      if (question.field && !question.blocks.empty()) list.push_back(&question);
    }
  }
}

}  // namespace

// Asks the device about all questions; has the CPU bake what blocks lack, and asks about these again. What is baked is
// what the CPU's kernels would have baked: all rays of such questions are asked about, whatever other occluders answer.
// slot_of(request, n): the candidate that question n is about.
template <class Question, class Request, class SlotOf>
void ShadowAnswerer::ask_and_bake(std::span<Request> requests, std::vector<Question*> DeviceWave::*list,
                                  const SlotOf& slot_of) const {
  DeviceWave wave;
  list_questions(requests, wave.*list);
  for (int round = 0; !wave.empty(); ++round) {
    device_->answer(wave);
    if (round == k_most_bake_rounds) return;
    for_each_request(requests, [&](Request& request) {
      for (size_t n = 0; n < request.questions.size(); ++n) {
        DeviceQuestion::Unbaked& unbaked = request.questions[n].unbaked;
        if (unbaked.empty()) continue;
        bake_unbaked(instances_[request.group.candidates[slot_of(request, n)]], unbaked, request.stats);
      }
    });
    wave = {};
    for (Request& request : requests) {
      for (Question& question : request.questions) {
        if (!question.unbaked.empty()) (wave.*list).push_back(&question);
      }
    }
  }
}

// Leaves nothing to ask again where there is no room.
void ShadowAnswerer::bake_unbaked(const ShadowInstance& o, DeviceQuestion::Unbaked& unbaked, Stats& stats) const {
  const uint32_t shape = scene_.instances[o.cone.segment.instance].shape;
  BakeCounters counters;
  for (std::vector<uint32_t>* numbers : {&unbaked.visibility, &unbaked.depth, &unbaked.tiles}) sort_unique(*numbers);
  if (!unbaked.tiles.empty()) bake_coverage(*o.field, unbaked.tiles, accel_, shape, counters);
  for (const auto& [layer, slices] :
       {std::pair(FieldLayer::visibility, &unbaked.visibility), std::pair(FieldLayer::depth, &unbaked.depth)}) {
    if (!slices->empty()) bake_slices(*o.field, layer, *slices, accel_, shape, counters);
  }
  stats.add_bake(counters);
  if (o.field->pool_full() || o.field->coverage().full()) unbaked = {};
}

void ShadowAnswerer::ask_cones(CandidateRequest& request) const {
  const ShadingPointBatch& points = request.points;
  const ShadowGroup& group = request.group;
  if (!group.is_tested) return;
  Workspace& work = workspace();
  const Sphere light = light_with_errors(points, group.light);
  request.questions.resize(group.candidates.size());
  for (uint32_t slot = 0; slot < group.candidates.size(); ++slot) {
    ConeQuestion& question = request.questions[slot];
    meet_bounds(slot, points, light, group, work);
    for (uint32_t block = 0; block < work.flags.size(); block += k_batch_padding) {
      add_block(question, block, wanted_mask(block, [&](uint32_t r) { return work.flags[r] != 0; }));
    }
    const ShadowInstance& o = instances_[group.candidates[slot]];
    uint32_t most_samples = 0;
    for (size_t i = 0; i < question.blocks.size(); ++i) {
      for_each_wanted(question, i, [&](uint32_t r) {
        question.samples += group.light_samples[r];
        most_samples = std::max(most_samples, group.light_samples[r]);
      });
    }
    if (!o.answers_cones || most_samples < k_fewest_cone_samples) continue;
    question.field = o.field;
    question.task = cone_task(o, group);
    question.points = &points;
    question.light = group.light.ball;
  }
}

void ShadowAnswerer::find_candidates(std::span<CandidateRequest> requests) const {
  for_each_request(requests, [&](CandidateRequest& request) {
    choose_candidates(request);
    ask_cones(request);
  });
  DeviceWave wave;
  list_questions(requests, wave.cones);
  device_->answer(wave);
  for_each_request(requests, [&](const CandidateRequest& request) { test_candidates(request); });
}

void ShadowAnswerer::ask_strata(FilterRequest& request) const {
  const ShadowGroup& group = request.group;
  const std::span<const uint32_t> shading_points = request.shading_points;
  const ShadowBatch& batch = request.batch;
  const auto strata = uint32_t(request.strata);
  std::vector<uint32_t> place(request.all.size, k_none);
  for (uint32_t r = 0; r < shading_points.size(); ++r) place[shading_points[r]] = r;
  std::vector<uint8_t> is_open;
  request.questions.resize(group.open.size());
  for (size_t n = 0; n < group.open.size(); ++n) {
    const ShadowGroup::OpenCandidate& open = group.open[n];
    is_open.assign(shading_points.size(), 0);
    for (uint32_t i = open.begin; i < open.end; ++i) {
      const uint32_t r = place[group.open_points[i]];
      if (r != k_none) is_open[r] = 1;
    }
    const ShadowInstance& o = instances_[group.candidates[open.slot]];
    StratumQuestion& question = request.questions[n];
    question.field = o.field;
    question.task = stratum_task(o, request.strata);
    question.batch = &batch;
    for (uint32_t block = 0; block < batch.rays.size; block += k_batch_padding) {
      add_block(question, block,
                wanted_mask(block, [&](uint32_t slot) { return slot < batch.rays.size && is_open[slot / strata]; }));
    }
    for (const uint32_t mask : question.wanted) question.samples += uint64_t(std::popcount(mask));
  }
}

void ShadowAnswerer::filter(std::span<FilterRequest> requests) const {
  for_each_request(requests, [&](FilterRequest& request) { ask_strata(request); });
  ask_and_bake(requests, &DeviceWave::strata,
               [](const FilterRequest& request, size_t n) { return request.group.open[n].slot; });
  for_each_request(requests, [&](const FilterRequest& request) { filter(request); });
}

void ShadowAnswerer::ask_rays(RayRequest& request) const {
  const ShadowGroup& group = request.group;
  const ShadowBatch& batch = request.batch;
  if (group.candidates.size() > k_most_candidates) return;
  request.questions.resize(group.candidates.size());
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const ShadowInstance& o = instances_[group.candidates[slot]];
    if (!o.in_ball || o.thesis || !o.field) continue;
    RayQuestion& question = request.questions[slot];
    question.field = o.field;
    question.task = ray_task(o, group);
    question.batch = &batch;
    for (uint32_t block = 0; block < batch.rays.size; block += k_batch_padding) {
      add_block(question, block, wanted_mask(block, [&](uint32_t i) { return batch.rays.tmax[i] >= 0.0f; }));
    }
    for (const uint32_t mask : question.wanted) question.samples += uint64_t(std::popcount(mask));
  }
}

void ShadowAnswerer::answer(std::span<RayRequest> requests) const {
  for_each_request(requests, [&](RayRequest& request) { ask_rays(request); });
  ask_and_bake(requests, &DeviceWave::rays, [](const RayRequest&, size_t n) { return n; });
  for_each_request(requests, [&](const RayRequest& request) { answer(request); });
}

}  // namespace fieldtrace
