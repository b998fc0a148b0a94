#include "hybrid/light/light_receivers.h"

#include <algorithm>
#include <cstring>
#include <functional>
#include <numeric>

namespace fieldtrace {
namespace {

// Turns the normals (x, y, z) against the directions (dx, dy, dz).
void turn_against(const float* dx, const float* dy, const float* dz, const float* x, const float* y, const float* z,
                  size_t count, float* __restrict turned_x, float* __restrict turned_y, float* __restrict turned_z) {
  for (size_t i = 0; i < count; ++i) {
    const float sign = x[i] * dx[i] + y[i] * dy[i] + z[i] * dz[i] > 0.0f ? -1.0f : 1.0f;
    turned_x[i] = x[i] * sign, turned_y[i] = y[i] * sign, turned_z[i] = z[i] * sign;
  }
}

ReceiverKind kind_of(const Material& material) {
  if (material.plain_diffuse()) return ReceiverKind::diffuse;
  if (!material.coated_diffuse()) return ReceiverKind::other;
  return material.kind == BsdfKind::plastic ? ReceiverKind::smooth_coated : ReceiverKind::coated;
}

}  // namespace

void LightReceivers::clear(size_t most) {
  points.resize(most);
  points.size = 0;
  for (auto* v : {&red, &green, &blue}) v->resize(padded(most));
  for (auto* v : {&cluster, &path, &vertex}) v->resize(padded(most));
  kind.resize(padded(most));
}

void LightReceivers::add(const PathVertex& v, uint32_t index, const PathState& state, uint32_t cluster_number) {
  const Material& material = *v.material;
  if (material.delta() || material.dark) return;
  const size_t i = add_point(*v.surface, v.facing, v.frame.n);
  points.seed[i] = v.seed, points.sample[i] = state.index;
  points.transmits[i] = material.transmits();
  kind[i] = kind_of(material);
  reflect(i, kind[i] == ReceiverKind::diffuse ? material.reflectance : Rgb(0.0f));
  cluster[i] = cluster_number, path[i] = v.path, vertex[i] = index;
}

size_t LightReceivers::add_point(const SurfacePoint& at, const Vec3& facing, const Vec3& shading) {
  const size_t i = points.size++;
  ShadingPointBatch& p = points;
  p.px[i] = at.position.x, p.py[i] = at.position.y, p.pz[i] = at.position.z;
  p.gx[i] = facing.x, p.gy[i] = facing.y, p.gz[i] = facing.z;
  p.sx[i] = shading.x, p.sy[i] = shading.y, p.sz[i] = shading.z;
  p.error[i] = at.error;
  p.instance[i] = at.instance;
  return i;
}

size_t LightReceivers::add_run(const RayBatch& rays, const SurfaceBatch& s, const HitRun& run, uint32_t instance,
                               const Material& material) {
  const size_t i = points.size, from = run.begin, count = run.end - run.begin;
  points.size += count;
  ShadingPointBatch& p = points;
  using Array = AlignedVector<float>;
  const auto copy = [=](const Array& source, Array& target) { std::copy_n(&source[from], count, &target[i]); };
  copy(s.px, p.px), copy(s.py, p.py), copy(s.pz, p.pz), copy(s.error, p.error);
  turn_against(&rays.dx[from], &rays.dy[from], &rays.dz[from], &s.gx[from], &s.gy[from], &s.gz[from], count, &p.gx[i],
               &p.gy[i], &p.gz[i]);
  copy(s.sx, p.sx), copy(s.sy, p.sy), copy(s.sz, p.sz);
  if (material.turned) {
    for (Array* a : {&p.sx, &p.sy, &p.sz}) std::transform(&(*a)[i], &(*a)[i] + count, &(*a)[i], std::negate<>());
  }
  const Rgb reflected = material.reflectance / k_pi;
  std::fill_n(&red[i], count, reflected.x);
  std::fill_n(&green[i], count, reflected.y);
  std::fill_n(&blue[i], count, reflected.z);
  std::fill_n(&p.instance[i], count, instance);
  std::fill_n(&p.transmits[i], count, uint8_t(0));
  std::fill_n(&kind[i], count, ReceiverKind::diffuse);
  std::iota(&path[i], &path[i] + count, run.begin);
  std::fill_n(&vertex[i], count, k_none);
  return i;
}

void LightReceivers::sort_by_instance(size_t begin, size_t end) {
  order_.clear();
  for (size_t i = begin; i < end; ++i) order_.push_back(uint64_t(points.instance[i]) << 32 | (i - begin));
  std::sort(order_.begin(), order_.end());
  const auto permute = [&](auto& values) {
    constexpr size_t bytes = sizeof(values[0]);
    moved_.resize(order_.size() * bytes);
    for (size_t i = 0; i < order_.size(); ++i)
      std::memcpy(&moved_[i * bytes], &values[begin + uint32_t(order_[i])], bytes);
    std::memcpy(&values[begin], moved_.data(), moved_.size());
  };
  ShadingPointBatch& p = points;
  for (auto* v : {&p.px, &p.py, &p.pz, &p.gx, &p.gy, &p.gz, &p.sx, &p.sy, &p.sz, &p.error, &red, &green, &blue}) {
    permute(*v);
  }
  for (auto* v : {&p.seed, &p.sample, &p.instance, &cluster, &path, &vertex}) permute(*v);
  permute(p.transmits), permute(kind);
}

}  // namespace fieldtrace
