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
  // A table that is copied to the device once (GpuDevice::Tables).
  struct Table {
    const void* host;
    size_t bytes;
  };

  // of == null: it is about no field.
  Question(const Field* of, std::vector<uint32_t> asked) : field(of), blocks(std::move(asked)) {}
  virtual ~Question() = default;
  // Puts the arrays into `in`, and makes room for the answers in `out` and for rays in `made`.
  virtual void stage(Wave& wave) = 0;
  // The tables that it refers to.
  virtual void list(std::vector<Table>&) const {}
  // Once `in` stays where it is on the device: completes pointers into it.
  virtual void settle(Wave&) {}
  // `view`: the field's on the device.
  virtual Status launch(Runtime& runtime, const FieldView& view, const Wave& wave) const = 0;
  virtual void take_answers(const StagingBuffer& out) = 0;
  virtual bool not_baked(size_t warp) const = 0;

  const Field* const field;
  const std::vector<uint32_t> blocks;  // that are asked about, by their first entry; warp i has the block i
  FieldMirror* mirror = nullptr;       // of the field, while it is submitted
  bool is_asked = false;               // the device answers, as far as it can
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

// The rays of a question: sent as they are, or made on the device from shading points where that is less to send.
class StagedRays {
 public:
  // What else a question has for each ray; null: not of it.
  struct Others {
    const float *pdf = nullptr, *radius = nullptr;
    const int32_t* wanted = nullptr;
    const uint32_t* instance = nullptr;
  };

  StagedRays(const RayBatch& rays, const LightRaySource& source, const Others& others,
             std::span<const uint32_t> blocks);
  void list(std::vector<GpuDevice::Question::Table>& tables) const;
  void stage(GpuDevice::Wave& wave);
  // Starts the kernel that makes them, if they are made there.
  Status launch(Runtime& runtime, const GpuDevice::Wave& wave) const;

  // After stage(), on the device.
  RayArrays arrays(const GpuDevice::Wave& wave) const;
  const float* pdf(const GpuDevice::Wave& wave) const { return place<const float>(wave, pdf_at_); }
  const float* radius(const GpuDevice::Wave& wave) const { return place<const float>(wave, radius_at_); }
  const int32_t* wanted(const GpuDevice::Wave& wave) const { return place<const int32_t>(wave, wanted_at_); }
  const uint32_t* instance(const GpuDevice::Wave& wave) const { return place<const uint32_t>(wave, instance_at_); }

 private:
  template <class T>
  T* place(const GpuDevice::Wave& wave, size_t at) const {
    return is_made_ ? wave.made.device<T>(at) : wave.in.device<T>(at);
  }
  void stage_points(StagingBuffer& in);

  const RayBatch& rays_;
  const LightRaySource source_;
  const Others others_;
  const std::span<const uint32_t> blocks_;
  const bool is_made_;
  size_t at_[7], pdf_at_ = 0, radius_at_ = 0, wanted_at_ = 0, instance_at_ = 0;
  size_t points_at_[15], blocks_at_ = 0;  // in the order of ReceiverArrays
};

}  // namespace fieldtrace::gpu
