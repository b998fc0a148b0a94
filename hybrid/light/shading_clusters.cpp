#include "hybrid/light/shading_clusters.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace fieldtrace {
namespace {

using Array = AlignedVector<float>;

Vec3 direction_of(const Vec3& sum, const Vec3& otherwise) {
  const float length = glm::length(sum);
  return length > 0.0f ? sum / length : otherwise;
}

// Sum of values[i] - origin, in eight running sums that the compiler vectorises, and in four where fewer are left.
float sum_from(const float* values, size_t count, float origin) {
  float sums[8] = {}, rest = 0.0f;
  size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    for (size_t j = 0; j < 8; ++j) sums[j] += values[i + j] - origin;
  }
  if (i + 4 <= count) {
    for (size_t j = 0; j < 4; ++j) sums[j] += values[i + j] - origin;
    i += 4;
  }
  for (; i < count; ++i) rest += values[i] - origin;
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])) + rest;
}

// The largest of value(i) >= 0 for i < count. As integers, which have the same order, because the compiler vectorises
// their maximum.
template <class Value>
float largest(size_t count, const Value& value) {
  int32_t most = 0;
  for (size_t i = 0; i < count; ++i) most = std::max(most, std::bit_cast<int32_t>(value(i)));
  return std::bit_cast<float>(most);
}

// Largest squared distance of points (x, y, z) from p.
float farthest(const float* x, const float* y, const float* z, size_t count, const Vec3& p) {
  return largest(count, [=](size_t i) {
    const float dx = x[i] - p.x, dy = y[i] - p.y, dz = z[i] - p.z;
    return dx * dx + dy * dy + dz * dz;
  });
}

// Bound on the length of n_i - n for unit vectors n_i, n being the direction of their mean, from the mean's length: the
// sum of 1 - n_i.n is their number times what that length lacks to 1.
float spread_bound(const Vec3& mean, size_t count) {
  const float lack = std::max(1.0f - glm::length(mean), 0.0f) + gamma_bound(16);
  return std::sqrt(2.0f * float(count) * lack);
}

bool is_far(const LightExtent& light, const Vec3& position, float radius) {
  return light.kind != LightExtent::Kind::bounded ||
         radius <= k_widest_cluster * glm::length(light.ball.centre - position);
}

// Whether point i forms a cluster with the first, whose number they share. Clusters are of one kind:
// what lights the former leaves the sky to no other ray.
bool joins(const LightReceivers& receivers, size_t first, size_t i) {
  const ShadingPointBatch& p = receivers.points;
  return p.instance[i] == p.instance[first] && !p.transmits[i] && receivers.kind[i] == receivers.kind[first] &&
         p.gx[i] * p.gx[first] + p.gy[i] * p.gy[first] + p.gz[i] * p.gz[first] > 0.0f;
}

// Whether all points of [first + 1, end) do; they must lie on one instance.
bool all_join(const LightReceivers& receivers, size_t first, size_t end) {
  const ShadingPointBatch& p = receivers.points;
  const float x = p.gx[first], y = p.gy[first], z = p.gz[first];
  const float *gx = p.gx.data(), *gy = p.gy.data(), *gz = p.gz.data();
  const uint8_t* const transmits = p.transmits.data();
  uint32_t others = 0;
  for (size_t i = first + 1; i < end; ++i) others += !(gx[i] * x + gy[i] * y + gz[i] * z > 0.0f);
  const ReceiverKind* const kind = receivers.kind.data();
  return others == 0 && !std::memchr(transmits + first + 1, 1, end - first - 1) &&
         std::all_of(kind + first + 1, kind + end, [&](ReceiverKind k) { return k == kind[first]; });
}

size_t number_end(const LightReceivers& r, size_t begin) {
  size_t end = begin + 1;
  for (const size_t step : {64, 8, 1}) {
    while (end + step <= r.size() && r.cluster[end + step - 1] == r.cluster[begin]) end += step;
  }
  return end;
}

bool on_one_instance(const ShadingPointBatch& p, size_t begin, size_t end) {
  const uint32_t* const instances = p.instance.data();
  uint32_t others = 0;
  for (size_t i = begin + 1; i < end; ++i) others += instances[i] != instances[begin];
  return others == 0;
}

}  // namespace

void ShadingClusters::add_single(const LightReceivers& receivers, size_t i) {
  const size_t c = clusters_.size();
  clusters_.push_back({uint32_t(i), uint32_t(i + 1), 0.0f, receivers.kind[i]});
  centres_.copy(c, receivers.points, i);
  centres_.sample[c] = 0;
}

void ShadingClusters::add(const LightReceivers& receivers, std::span<const LightExtent> lights, size_t begin,
                          size_t end) {
  const size_t count = end - begin;
  if (count == 1) return add_single(receivers, begin);
  const ShadingPointBatch& p = receivers.points;
  const auto mean = [&](const Array& values, float origin) {
    return origin + sum_from(&values[begin], count, origin) / float(count);
  };
  const Vec3 position(mean(p.px, p.px[begin]), mean(p.py, p.py[begin]), mean(p.pz, p.pz[begin]));
  const float radius =
      std::sqrt(farthest(&p.px[begin], &p.py[begin], &p.pz[begin], count, position)) * (1.0f + gamma_bound(8));
  const auto far = [&](const LightExtent& light) { return is_far(light, position, radius); };
  if (!std::all_of(lights.begin(), lights.end(), far)) {
    for (size_t i = begin; i < end; ++i) add_single(receivers, i);
    return;
  }
  const Vec3 facing(mean(p.gx, 0.0f), mean(p.gy, 0.0f), mean(p.gz, 0.0f));
  const Vec3 shading(mean(p.sx, 0.0f), mean(p.sy, 0.0f), mean(p.sz, 0.0f));
  const bool as_before = facing == before_.facing && shading == before_.shading && count == before_.count;
  if (!as_before || shading == Vec3(0.0f)) {
    before_ = {facing,
               shading,
               count,
               direction_of(facing, p.geometric_normal(begin)),
               direction_of(shading, p.shading_normal(begin)),
               std::max(spread_bound(facing, count), spread_bound(shading, count))};
  }
  const Vec3 &g = before_.geometric, &s = before_.shading_direction;
  const size_t i = clusters_.size();
  clusters_.push_back({uint32_t(begin), uint32_t(end), before_.spread, receivers.kind[begin]});
  ShadingPointBatch& c = centres_;
  c.px[i] = position.x, c.py[i] = position.y, c.pz[i] = position.z;
  c.gx[i] = g.x, c.gy[i] = g.y, c.gz[i] = g.z;
  c.sx[i] = s.x, c.sy[i] = s.y, c.sz[i] = s.z;
  c.error[i] = largest(count, [error = &p.error[begin]](size_t k) { return error[k]; });
  c.radius[i] = radius;
  c.seed[i] = p.seed[begin], c.sample[i] = 0, c.instance[i] = p.instance[begin];
  c.transmits[i] = p.transmits[begin];
}

void ShadingClusters::build(LightReceivers& receivers, std::span<const LightExtent> lights, uint32_t most,
                            bool single) {
  const ShadingPointBatch& p = receivers.points;
  clusters_.clear();
  centres_.resize(p.size);
  before_ = {};
  if (single) {
    for (size_t i = 0; i < p.size; ++i) {
      clusters_.push_back({uint32_t(i), uint32_t(i + 1), 0.0f, receivers.kind[i]});
    }
    centres_.copy(0, p, 0, p.size);
    std::fill_n(centres_.sample.begin(), centres_.size, 0u);
    return;
  }
  size_t last = 0;
  bool is_even = true;
  for (size_t begin = 0, end = 0; begin < p.size; begin = end) {
    if (begin == last) {
      last = number_end(receivers, begin);
      is_even = on_one_instance(p, begin, last);
      if (!is_even) receivers.sort_by_instance(begin, last);
    }
    end = std::min(last, begin + most);
    if (!is_even || !all_join(receivers, begin, end)) {
      const size_t most_end = end;
      for (end = begin + 1; end < most_end && joins(receivers, begin, end);) ++end;
    }
    add(receivers, lights, begin, end);
  }
}

}  // namespace fieldtrace
