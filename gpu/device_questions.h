// The questions that go to a GPU in waves: what each sends, launches and takes back. Internal to gpu/device.cpp.
//
// Thread-safety: a question belongs to the thread that asks it, which waits while a wave uses it.
#pragma once

#include <bit>
#include <vector>

#include "gpu/device.h"

namespace fieldtrace::gpu {

static_assert(k_warp == k_batch_padding);

struct GpuDevice::Question {
  Question(const Field& of, std::vector<uint32_t> asked) : field(of), blocks(std::move(asked)) {}
  virtual ~Question() = default;
  // Puts the arrays into `in`, and makes room for the answers in `out`.
  virtual void stage(StagingBuffer& in, StagingBuffer& out) = 0;
  // `view`: the field's on the device.
  virtual Status launch(Runtime& runtime, const FieldView& view, const Wave& wave) const = 0;
  virtual void take_answers(const StagingBuffer& out) = 0;
  virtual bool not_baked(size_t warp) const = 0;

  const Field& field;
  const std::vector<uint32_t> blocks;  // that are asked about, by their first entry; warp i has the block i
  FieldMirror* mirror = nullptr;       // of the field, while it is submitted; null: the CPU answers
  size_t missing = 0;                  // place of its words
  bool is_taken = false, is_done = false, is_answered = false;  // by a wave
};

// The entries of `blocks` in an array.
template <class T>
size_t stage_blocks(StagingBuffer& in, const T* from, std::span<const uint32_t> blocks) {
  const size_t at = in.reserve(blocks.size() * k_warp * sizeof(T));
  T* to = in.host<T>(at);
  for (const uint32_t block : blocks) to = std::copy_n(from + block, k_warp, to);
  return at;
}

template <class Masks>
struct MaskQuestion : GpuDevice::Question {
  using Question::Question;

  void stage_masks(StagingBuffer& out) { masks_at = out.reserve(blocks.size() * sizeof(Masks)); }
  void take_answers(const StagingBuffer& out) override {
    const Masks* from = out.host<Masks>(masks_at);
    masks.assign(from, from + blocks.size());
  }
  bool not_baked(size_t warp) const override { return masks[warp].not_baked != 0; }

  size_t masks_at = 0;
  std::vector<Masks> masks;
};

struct StagedRays {
  size_t at[7];

  void stage(StagingBuffer& in, const RayBatch& rays, std::span<const uint32_t> blocks) {
    const AlignedVector<float>* const arrays[] = {&rays.ox, &rays.oy, &rays.oz,  &rays.dx,
                                                  &rays.dy, &rays.dz, &rays.tmax};
    for (int i = 0; i < 7; ++i) at[i] = stage_blocks(in, arrays[i]->data(), blocks);
  }
  RayArrays on_device(const StagingBuffer& in) const {
    const auto array = [&](int i) { return in.device<const float>(at[i]); };
    return {array(0), array(1), array(2), array(3), array(4), array(5), array(6)};
  }
};

}  // namespace fieldtrace::gpu
