// Single questions to a device, or to the CPU's kernels alone. Thread-safety: as the device's.
#pragma once

#include "gpu/device_arguments.h"
#include "hybrid/visibility/device_answers.h"
#include "tests/gpu/random_questions.h"

namespace fieldtrace::gpu {

// Who answers: the device first, if there is one.
struct Answerer {
  const SegmentKernels& kernels;
  VisibilityDevice* device = nullptr;
};

inline std::vector<uint32_t> blocks_of(size_t entries) {
  std::vector<uint32_t> blocks;
  for (size_t b = 0; b < padded(entries); b += k_warp) blocks.push_back(uint32_t(b));
  return blocks;
}

// A question about the entries for which is_wanted(entry).
template <class Question, class Task, class IsWanted>
Question question_about(const Field& field, const Task& task, size_t entries, const IsWanted& is_wanted) {
  Question q;
  q.field = &field;
  q.task = task;
  for (const uint32_t block : blocks_of(entries)) add_block(q, block, wanted_mask(block, is_wanted));
  q.samples = entries;
  return q;
}

inline SegmentCounts ask_rays(const Answerer& by, const Field& field, const SegmentTask& task, const ShadowBatch& batch,
                              RayStates& states) {
  auto q = question_about<RayQuestion>(field, task, batch.rays.size, [](uint32_t) { return true; });
  q.batch = &batch;
  DeviceWave wave;
  wave.rays.push_back(&q);
  if (by.device) by.device->answer(wave);
  return query(by.kernels, &q, task, batch, blocks_of(batch.rays.size), 0, states);
}

// Rays that were not made from a light's samples.
inline ShadowBatch batch_of(const RayBatch& rays, const AlignedVector<uint32_t>& instances) {
  ShadowBatch batch;
  batch.resize(rays.size);
  batch.rays = rays;
  batch.instance = instances;
  return batch;
}

inline uint64_t ask_strata(const Answerer& by, const Field& field, const StratumInputs& in, float* clear,
                           int32_t* refused, ConeUnknowns& unknowns) {
  ShadowBatch batch;
  batch.resize(in.rays.size);
  batch.rays = in.rays;
  batch.pdf = in.pdf;
  auto q = question_about<StratumQuestion>(field, in.task, in.rays.size, [&](uint32_t i) { return in.wanted[i] != 0; });
  q.batch = &batch;
  q.radius = in.radius.data();
  DeviceWave wave;
  wave.strata.push_back(&q);
  if (by.device) by.device->answer(wave);
  return filter_strata(by.kernels, &q, in.task, batch, in.radius.data(), in.wanted.data(), blocks_of(in.rays.size),
                       clear, refused, unknowns);
}

inline uint64_t ask_lobes(const Answerer& by, const CoverageTiles& tiles, const LobeInputs& in, LobeAnswers& answers,
                          ConeUnknowns& unknowns) {
  LobeQuestion q;
  q.task = in.task;
  q.tiles = &tiles;
  q.batch = &in.lobes;
  q.samples = in.lobes.rays.size;
  for (const uint32_t block : blocks_of(in.lobes.rays.size)) add_block(q, block, k_all_lanes);
  DeviceWave wave;
  wave.lobes.push_back(&q);
  if (by.device) by.device->answer(wave);
  return filter_lobes(by.kernels, &q, in.task, in.lobes, blocks_of(in.lobes.rays.size), answers, unknowns);
}

inline ConeCounts ask_cones(const Answerer& by, const Field& field, const ConeInputs& in, int32_t* flags,
                            ConeUnknowns& unknowns) {
  auto q = question_about<ConeQuestion>(field, in.task, in.points.size,
                                        [&](uint32_t r) { return (in.flags[r] & k_may_shadow) != 0; });
  q.points = &in.points;
  q.light = in.light;
  DeviceWave wave;
  wave.cones.push_back(&q);
  if (by.device) by.device->answer(wave);
  return light_cones(by.kernels, &q, in.task, in.points, in.light, blocks_of(in.points.size), flags, unknowns);
}

}  // namespace fieldtrace::gpu
