#include "gpu/wave_arrays.h"

#include <algorithm>
#include <array>
#include <bit>

#include "core/light/light_sampling.h"

namespace fieldtrace::gpu {
namespace {

using Points = ShadingPointBatch;

constexpr AlignedVector<float> Points::*k_floats[] = {&Points::px, &Points::py,    &Points::pz,    &Points::gx,
                                                      &Points::gy, &Points::gz,    &Points::sx,    &Points::sy,
                                                      &Points::sz, &Points::error, &Points::radius};
constexpr AlignedVector<uint32_t> Points::*k_words[] = {&Points::seed, &Points::sample, &Points::instance};
constexpr bool is_shading_normal(size_t i) { return i >= 6 && i < 9; }
constexpr size_t k_instance = 2;  // of k_words

bool any_transmits(const Points& p) {
  return std::any_of(p.transmits.begin(), p.transmits.begin() + std::ptrdiff_t(p.size),
                     [](uint8_t t) { return t != 0; });
}

template <class T>
void append_bytes(std::string& key, const T& value) {
  key.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

void WavePoints::clear() {
  batches_.clear();
  places_.clear();
  size_ = 0;
}

uint32_t WavePoints::add(const ShadingPointBatch& batch) {
  const auto [found, is_new] = places_.try_emplace(&batch, size_);
  if (is_new) {
    batches_.emplace_back(&batch, size_);
    size_ += uint32_t(padded(batch.size));
  }
  return found->second;
}

template <class T>
size_t WavePoints::stage_array(StagingBuffer& in, const AlignedVector<T> ShadingPointBatch::*array) const {
  const size_t at = in.reserve(size_ * sizeof(T));
  T* const to = in.host<T>(at);
  for (const auto& [batch, first] : batches_) std::copy_n((batch->*array).data(), padded(batch->size), to + first);
  return at;
}

size_t WavePoints::stage_transmits(StagingBuffer& in) const {
  const size_t at = in.reserve(size_ / k_warp * sizeof(uint32_t));
  uint32_t* const to = in.host<uint32_t>(at);
  std::fill_n(to, size_ / k_warp, 0u);
  for (const auto& [batch, first] : batches_) {
    for (uint32_t i = 0; i < batch->size; ++i) {
      to[(first + i) / k_warp] |= uint32_t(batch->transmits[i] != 0) << (i % k_warp);
    }
  }
  return at;
}

void WavePoints::stage(StagingBuffer& in) {
  if (size_ == 0) return;
  const bool all = use_ == Use::light_samples;
  for (size_t i = 0; i < std::size(k_floats); ++i) {
    if (all || !is_shading_normal(i)) floats_at_[i] = stage_array<float>(in, k_floats[i]);
  }
  for (size_t i = 0; i < std::size(k_words); ++i) {
    if (all || i == k_instance) words_at_[i] = stage_array<uint32_t>(in, k_words[i]);
  }
  transmits_at_ = stage_transmits(in);
}

PointArrays WavePoints::for_cones(const StagingBuffer& in) const {
  const auto f = [&](int i) { return in.device<const float>(floats_at_[i]); };
  return {f(0),
          f(1),
          f(2),
          f(3),
          f(4),
          f(5),
          f(9),
          f(10),
          in.device<const uint32_t>(words_at_[k_instance]),
          in.device<const uint32_t>(transmits_at_)};
}

ReceiverArrays WavePoints::for_light_samples(const StagingBuffer& in) const {
  const auto f = [&](int i) { return in.device<const float>(floats_at_[i]); };
  const auto w = [&](int i) { return in.device<const uint32_t>(words_at_[i]); };
  return {f(0),  f(1), f(2), f(3), f(4),
          f(5),  f(6), f(7), f(8), f(9),
          f(10), w(0), w(1), w(2), in.device<const uint32_t>(transmits_at_)};
}

void WaveRays::clear() {
  batches_.clear();
  making_of_.clear();
  makings_.clear();
  sets_.assign(1, {});
}

WaveRays::Place WaveRays::add(const ShadowBatch& batch, const float* radius, WavePoints& points) {
  const auto [found, is_new] = batches_.try_emplace(&batch);
  Batch& b = found->second;
  if (!is_new) return b.place;
  const LightRaySource& source = batch.source;
  if (!source.lights) {
    b.place = {sets_.size(), 0};
    sets_.push_back({&batch, radius});
    return b.place;
  }
  b.point = points.add(*source.points);
  const bool transmits = any_transmits(*source.points), by_number = source.slots != nullptr;
  std::string key;
  append_bytes(key, std::bit_cast<uintptr_t>(source.lights));
  append_bytes(key, source.light);
  append_bytes(key, source.range);
  append_bytes(key, transmits);
  append_bytes(key, by_number);
  const auto [making, is_first] = making_of_.try_emplace(key, makings_.size());
  if (is_first) makings_.push_back({source, transmits, by_number});
  makings_[making->second].batches.push_back(&batch);
  return b.place;
}

void WaveRays::list_tables(const LightRaySource& source, std::vector<HostTable>& tables) {
  if (!source.lights) return;
  const auto list = [&](const auto& table) { tables.push_back({table.data(), table.size() * sizeof table[0]}); };
  if (source.range.columns == 0) list(source.lights->point_sets);
  const LightKind kind = source.lights->lights[source.light].kind;
  if (kind == LightKind::mesh) list(source.lights->triangles);
  if (kind != LightKind::environment) return;
  list(source.lights->environment.rows);
  list(source.lights->environment.sums);
  list(source.lights->environment.texels);
}

// Entries of the made arrays from `first` on.
void WaveRays::stage_making(Making& making, uint32_t first, StagingBuffer& in) {
  making.first = first;
  making.warps = 0;
  for (const ShadowBatch* batch : making.batches) {
    batches_[batch].place.first = first + making.warps * k_warp;
    making.warps += uint32_t(padded(batch->rays.size) / k_warp);
  }
  making.blocks_at = in.reserve(making.warps * sizeof(LightRayBlock));
  LightRayBlock* block = in.host<LightRayBlock>(making.blocks_at);
  for (const ShadowBatch* batch : making.batches) {
    const uint32_t size = uint32_t(batch->rays.size);
    for (uint32_t slot = 0; slot < size; slot += k_warp) *block++ = {batches_[batch].point, slot, size};
  }
  if (!making.by_number) return;
  making.numbers_at = in.reserve(making.warps * k_warp * sizeof(uint32_t));
  uint32_t* const numbers = in.host<uint32_t>(making.numbers_at);
  for (const ShadowBatch* batch : making.batches) {
    std::copy_n(batch->source.slots, batch->rays.size, numbers + (batches_[batch].place.first - first));
  }
}

void WaveRays::stage(StagingBuffer& in, StagingBuffer& made) {
  uint32_t entries = 0;
  for (Making& making : makings_) {
    stage_making(making, entries, in);
    entries += making.warps * k_warp;
  }
  Set& of_made = sets_[k_made];
  const size_t bytes = entries * sizeof(float);
  for (size_t& at : of_made.at) at = made.reserve(bytes);
  for (size_t* at : {&of_made.pdf_at, &of_made.radius_at, &of_made.instance_at}) *at = made.reserve(bytes);
  for (size_t i = k_made + 1; i < sets_.size(); ++i) {
    Set& set = sets_[i];
    const RayBatch& r = set.batch->rays;
    const size_t count = padded(r.size);
    const AlignedVector<float>* const arrays[] = {&r.ox, &r.oy, &r.oz, &r.dx, &r.dy, &r.dz, &r.tmax};
    for (int a = 0; a < 7; ++a) set.at[a] = in.append(arrays[a]->data(), count * sizeof(float));
    if (set.host_radius) {
      set.pdf_at = in.append(set.batch->pdf.data(), count * sizeof(float));
      set.radius_at = in.append(set.host_radius, count * sizeof(float));
    } else {
      set.instance_at = in.append(set.batch->instance.data(), count * sizeof(uint32_t));
    }
  }
}

void WaveRays::start(Runtime& runtime, Stream stream, const StagingBuffer& in, const StagingBuffer& made,
                     const WavePoints& points, const DeviceTables& tables) const {
  const Set& to = sets_[k_made];
  for (const Making& m : makings_) {
    if (m.warps == 0) continue;
    const LightTable& lights = *m.source.lights;
    const Light& light = lights.lights[m.source.light];
    const auto out = [&](size_t at) { return made.device<float>(at) + m.first; };
    LightRayArguments a = {light,
                           m.source.light,
                           m.source.range,
                           m.any_transmits,
                           points.for_light_samples(in),
                           {},
                           in.device<const LightRayBlock>(m.blocks_at),
                           m.by_number ? in.device<const uint32_t>(m.numbers_at) : nullptr,
                           out(to.at[0]),
                           out(to.at[1]),
                           out(to.at[2]),
                           out(to.at[3]),
                           out(to.at[4]),
                           out(to.at[5]),
                           out(to.at[6]),
                           out(to.pdf_at),
                           out(to.radius_at),
                           made.device<uint32_t>(to.instance_at) + m.first,
                           m.warps};
    if (m.source.range.columns == 0) a.tables.point_sets = tables.at<const int32_t>(lights.point_sets.data());
    if (light.kind == LightKind::mesh) a.tables.triangles = tables.at<const LightTriangle>(lights.triangles.data());
    if (light.kind == LightKind::environment) {
      const EnvironmentTable& e = lights.environment;
      a.tables.rows = tables.at<const EnvironmentRow>(e.rows.data());
      a.tables.sums = tables.at<const float>(e.sums.data());
      a.tables.texels = tables.at<const float>(e.texels.data());
    }
    check(runtime, runtime.launch(stream, Kernel::light_rays, m.warps, &a, sizeof a), "starting the kernel light_rays");
  }
}

RayArrays WaveRays::arrays(size_t set, const StagingBuffer& in, const StagingBuffer& made) const {
  const auto array = [&](int i) { return place<float>(set, sets_[set].at[i], in, made); };
  return {array(0), array(1), array(2), array(3), array(4), array(5), array(6)};
}
const float* WaveRays::pdf(size_t set, const StagingBuffer& in, const StagingBuffer& made) const {
  return place<float>(set, sets_[set].pdf_at, in, made);
}
const float* WaveRays::radius(size_t set, const StagingBuffer& in, const StagingBuffer& made) const {
  return place<float>(set, sets_[set].radius_at, in, made);
}
const uint32_t* WaveRays::instance(size_t set, const StagingBuffer& in, const StagingBuffer& made) const {
  return place<uint32_t>(set, sets_[set].instance_at, in, made);
}

void WaveLobes::clear() {
  batches_.clear();
  places_.clear();
  size_ = 0;
}

uint32_t WaveLobes::add(const LobeBatch& batch) {
  const auto [found, is_new] = places_.try_emplace(&batch, size_);
  if (is_new) {
    batches_.emplace_back(&batch, size_);
    size_ += uint32_t(padded(batch.rays.size));
  }
  return found->second;
}

void WaveLobes::stage(StagingBuffer& in) {
  if (size_ == 0) return;
  const auto floats_of = [](const LobeBatch& b) {
    const RayBatch& r = b.rays;
    return std::array{&r.ox, &r.oy, &r.oz, &r.dx, &r.dy, &r.dz, &r.tmax, &b.nx, &b.ny, &b.nz, &b.density, &b.blur};
  };
  for (size_t i = 0; i < std::size(floats_at_); ++i) {
    floats_at_[i] = in.reserve(size_ * sizeof(float));
    float* const to = in.host<float>(floats_at_[i]);
    for (const auto& [batch, first] : batches_) {
      std::copy_n(floats_of(*batch)[i]->data(), padded(batch->rays.size), to + first);
    }
  }
  instance_at_ = in.reserve(size_ * sizeof(uint32_t));
  uint32_t* const to = in.host<uint32_t>(instance_at_);
  for (const auto& [batch, first] : batches_) {
    std::copy_n(batch->instance.data(), padded(batch->rays.size), to + first);
  }
}

LobeArrays WaveLobes::arrays(const StagingBuffer& in) const {
  const auto f = [&](int i) { return in.device<const float>(floats_at_[i]); };
  return {{f(0), f(1), f(2), f(3), f(4), f(5), f(6)}, f(7), f(8), f(9), f(10), f(11),
          in.device<const uint32_t>(instance_at_)};
}

}  // namespace fieldtrace::gpu
