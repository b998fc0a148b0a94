#include "gpu/device_launches.h"

#include <algorithm>
#include <bit>

namespace fieldtrace::gpu {
namespace {

// Questions of one kind about one occluder.
template <class Question, class Masks>
class MaskLaunch : public KernelLaunch {
 public:
  using KernelLaunch::KernelLaunch;

  // `first`: the place of the arrays that the question's blocks count in.
  void add(Item& item, Question& question, uint32_t first) {
    parts_.push_back({&item, &question, first, warps});
    warps += uint32_t(item.warps.size());
  }

  void stage(WaveBuffers& wave) override {
    blocks_at = wave.in.reserve(warps * sizeof(uint32_t));
    wanted_at = wave.in.reserve(warps * sizeof(uint32_t));
    uint32_t* block = wave.in.host<uint32_t>(blocks_at);
    for (const Part& p : parts_) {
      for (const uint32_t w : p.item->warps) *block++ = p.first + p.question->blocks[w];
    }
    uint32_t* wanted = wave.in.host<uint32_t>(wanted_at);
    for (const Part& p : parts_) {
      for (const uint32_t w : p.item->warps) *wanted++ = p.question->wanted[w];
    }
    masks_at = wave.out.reserve(warps * sizeof(Masks));
    missing_at = wave.missing.reserve(warps * k_missing_bytes);
  }

  void take_answers(const WaveBuffers& wave) override {
    const Masks* const masks = wave.out.host<Masks>(masks_at);
    Masks not_baked = {};
    not_baked.not_baked = k_all_lanes;
    for (const Part& p : parts_) {
      p.question->masks.resize(p.question->blocks.size(), not_baked);
      p.question->is_answered = true;
      for (size_t i = 0; i < p.item->warps.size(); ++i) {
        const uint32_t from = p.first_warp + uint32_t(i), warp = p.item->warps[i];
        take_more(*p.question, warp, from, wave);
        p.question->masks[warp] = masks[from];
        if (masks[from].not_baked) p.item->unbaked.push_back({warp, missing_at + from * k_missing_bytes});
      }
    }
  }

 protected:
  virtual void take_more(Question&, uint32_t, uint32_t, const WaveBuffers&) {}
  const uint32_t* blocks(const WaveBuffers& wave) const { return wave.in.device<const uint32_t>(blocks_at); }
  const uint32_t* wanted(const WaveBuffers& wave) const { return wave.in.device<const uint32_t>(wanted_at); }
  Masks* masks(const WaveBuffers& wave) const { return wave.out.device<Masks>(masks_at); }
  uint32_t* missing(const WaveBuffers& wave) const { return wave.missing.device<uint32_t>(missing_at); }
  const Question& first_question() const { return *parts_[0].question; }

  uint32_t warps = 0;

 private:
  static constexpr size_t k_missing_bytes = k_missing_words * sizeof(uint32_t);
  struct Part {
    Item* item;
    Question* question;
    uint32_t first, first_warp;
  };
  std::vector<Part> parts_;
  size_t blocks_at = 0, wanted_at = 0, masks_at = 0, missing_at = 0;
};

class ConeLaunch final : public MaskLaunch<ConeQuestion, ConeMasks> {
 public:
  explicit ConeLaunch(const ConeQuestion& q) : MaskLaunch(&q.field->coverage()) {}
  void start(Runtime& runtime, const FieldView& view, const WaveBuffers& wave) const override {
    const ConeQuestion& q = first_question();
    ConeArguments a = {q.task,         {q.light.centre.x, q.light.centre.y, q.light.centre.z},
                       q.light.radius, wave.cone_points.for_cones(wave.in),
                       blocks(wave),   wanted(wave),
                       masks(wave),    missing(wave),
                       warps};
    a.task.segment.field = view;
    start_kernel(runtime, wave, Kernel::light_cones, a);
  }
};

class StratumLaunch final : public MaskLaunch<StratumQuestion, ShareMasks> {
 public:
  StratumLaunch(const StratumQuestion& q, size_t set) : MaskLaunch(&q.field->coverage()), set_(set) {}
  void stage(WaveBuffers& wave) override {
    MaskLaunch::stage(wave);
    clear_at_ = wave.out.reserve(warps * k_warp * sizeof(float));
  }
  void start(Runtime& runtime, const FieldView& view, const WaveBuffers& wave) const override {
    StratumArguments a = {first_question().task,
                          wave.rays.arrays(set_, wave.in, wave.made),
                          wave.rays.pdf(set_, wave.in, wave.made),
                          wave.rays.radius(set_, wave.in, wave.made),
                          blocks(wave),
                          wanted(wave),
                          wave.out.device<float>(clear_at_),
                          masks(wave),
                          missing(wave),
                          warps};
    a.task.segment.field = view;
    start_kernel(runtime, wave, Kernel::filter_strata, a);
  }

 private:
  void take_more(StratumQuestion& q, uint32_t warp, uint32_t from, const WaveBuffers& wave) override {
    q.clear.resize(q.blocks.size() * k_warp);
    std::copy_n(wave.out.host<float>(clear_at_) + from * k_warp, k_warp, q.clear.data() + warp * k_warp);
  }

  const size_t set_;
  size_t clear_at_ = 0;
};

class RayLaunch final : public MaskLaunch<RayQuestion, RayMasks> {
 public:
  RayLaunch(const RayQuestion& q, size_t set) : MaskLaunch(&q.field->coverage()), set_(set) {}
  void start(Runtime& runtime, const FieldView& view, const WaveBuffers& wave) const override {
    QueryArguments a = {first_question().task,
                        wave.rays.arrays(set_, wave.in, wave.made),
                        wave.rays.instance(set_, wave.in, wave.made),
                        blocks(wave),
                        masks(wave),
                        missing(wave),
                        warps};
    a.task.field = view;
    start_kernel(runtime, wave, Kernel::query, a);
  }

 private:
  const size_t set_;
};

class LobeLaunch final : public MaskLaunch<LobeQuestion, ShareMasks> {
 public:
  explicit LobeLaunch(const LobeQuestion& q) : MaskLaunch(q.tiles) {}
  void stage(WaveBuffers& wave) override {
    MaskLaunch::stage(wave);
    for (size_t& at : values_at_) at = wave.out.reserve(warps * k_warp * sizeof(float));
  }
  void start(Runtime& runtime, const FieldView& view, const WaveBuffers& wave) const override {
    const auto values = [&](int i) { return wave.out.device<float>(values_at_[i]); };
    LobeArguments a = {first_question().task,
                       wave.lobes.arrays(wave.in),
                       blocks(wave),
                       values(0),
                       values(1),
                       values(2),
                       values(3),
                       values(4),
                       masks(wave),
                       missing(wave),
                       warps};
    a.task.segment.field = view;
    start_kernel(runtime, wave, Kernel::filter_lobes, a);
  }

 private:
  void take_more(LobeQuestion& q, uint32_t warp, uint32_t from, const WaveBuffers& wave) override {
    const size_t entries = q.blocks.size() * k_warp;
    q.values.resize(k_lobe_values * entries);
    for (size_t v = 0; v < k_lobe_values; ++v) {
      std::copy_n(wave.out.host<float>(values_at_[v]) + from * k_warp, k_warp,
                  q.values.data() + v * entries + warp * k_warp);
    }
  }

  size_t values_at_[k_lobe_values] = {};
};

template <class... Functions>
struct Overloaded : Functions... {
  using Functions::operator()...;
};
template <class... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;

template <class... T>
void append_bytes(std::string& key, const T&... values) {
  (key.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
}

// Member by member, since padding differs from one task to the next. What is seen of the field is the source's.
void append_task(std::string& key, const SegmentTask& t) {
  append_bytes(key, t.policy.visibility_max_class, t.policy.depth_max_class, t.policy.answer_all, t.policy.slack,
               t.to_unit, t.to_unit_stretch, t.to_unit_area, t.keeps_angles, t.instance, t.self_only, t.reads_depth);
}
void append_task(std::string& key, const ConeTask& t) {
  append_task(key, t.segment);
  append_bytes(key, t.from_unit, t.half_extent, t.plane_fit_side);
}
void append_task(std::string& key, const StratumTask& t) {
  append_task(key, t.segment);
  append_bytes(key, t.share, t.least_disc);
}

}  // namespace

template <class Kind, class... Arguments>
Kind& WaveLaunches::launch_for(const std::string& key, const Arguments&... arguments) {
  const auto [found, is_new] = launch_of_.try_emplace(key, launches_.size());
  if (is_new) launches_.push_back(std::make_unique<Kind>(arguments...));
  return static_cast<Kind&>(*launches_[found->second]);
}

void WaveLaunches::add(std::span<Item* const> items, WaveBuffers& wave) {
  wave.cone_points.clear();
  wave.receivers.clear();
  wave.rays.clear();
  wave.lobes.clear();
  const auto rays_of = [&](const auto& question, const float* radius) {
    return wave.rays.add(*question.batch, radius, wave.receivers);
  };
  // Rays' places are known once all are there.
  for (const Item* item : items) {
    if (!item->is_asked) continue;
    std::visit(Overloaded{[&](StratumQuestion* q) { rays_of(*q, q->radius); },
                          [&](RayQuestion* q) { rays_of(*q, nullptr); }, [](auto*) {}},
               item->question);
  }
  wave.rays.stage(wave.in, wave.made);
  for (Item* item : items) {
    if (!item->is_asked) continue;
    // The kind, and what it is about.
    std::string key(1, char(item->question.index()));
    append_bytes(key, std::bit_cast<uintptr_t>(item->source.tiles));
    const auto add_strata = [&](StratumQuestion& q) {
      const WaveRays::Place rays = rays_of(q, q.radius);
      append_task(key, q.task);
      append_bytes(key, rays.set);
      launch_for<StratumLaunch>(key, q, rays.set).add(*item, q, rays.first);
    };
    const auto add_rays = [&](RayQuestion& q) {
      const WaveRays::Place rays = rays_of(q, nullptr);
      append_task(key, q.task);
      append_bytes(key, rays.set);
      launch_for<RayLaunch>(key, q, rays.set).add(*item, q, rays.first);
    };
    const auto add_cones = [&](ConeQuestion& q) {
      append_task(key, q.task);
      append_bytes(key, q.light);
      launch_for<ConeLaunch>(key, q).add(*item, q, wave.cone_points.add(*q.points));
    };
    const auto add_lobes = [&](LobeQuestion& q) {
      append_task(key, q.task);
      launch_for<LobeLaunch>(key, q).add(*item, q, wave.lobes.add(*q.batch));
    };
    const auto add_sky = [&](SkyQuestion& q) {
      if (!sky_) {
        auto launch = make_sky_launch();
        sky_ = launch.get();
        launches_.push_back(std::move(launch));
      }
      sky_->add(q);
    };
    std::visit(Overloaded{[&](ConeQuestion* q) { add_cones(*q); }, [&](StratumQuestion* q) { add_strata(*q); },
                          [&](RayQuestion* q) { add_rays(*q); }, [&](LobeQuestion* q) { add_lobes(*q); },
                          [&](SkyQuestion* q) { add_sky(*q); }},
               item->question);
  }
  wave.cone_points.stage(wave.in);
  wave.receivers.stage(wave.in);
  wave.lobes.stage(wave.in);
  for (const auto& launch : launches_) launch->stage(wave);
}

void list_tables(const Item& item, std::vector<HostTable>& tables) {
  std::visit(Overloaded{[&](const StratumQuestion* q) { WaveRays::list_tables(q->batch->source, tables); },
                        [&](const RayQuestion* q) { WaveRays::list_tables(q->batch->source, tables); },
                        [&](const SkyQuestion* q) { list_sky_tables(*q, tables); }, [](const auto*) {}},
             item.question);
}

}  // namespace fieldtrace::gpu
