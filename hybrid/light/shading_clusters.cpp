#include "hybrid/light/shading_clusters.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

using Array = AlignedVector<float>;

Vec3 at(const Array& x, const Array& y, const Array& z, size_t i) { return {x[i], y[i], z[i]}; }

Vec3 direction_of(const Vec3& sum, const Vec3& otherwise) {
  const float length = glm::length(sum);
  return length > 0.0f ? sum / length : otherwise;
}

// Sum of values[i] - origin, in eight running sums that the compiler vectorises.
float sum_from(const float* values, size_t count, float origin) {
  float sums[8] = {};
  size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    for (size_t j = 0; j < 8; ++j) sums[j] += values[i + j] - origin;
  }
  for (size_t j = 0; i < count; ++i, ++j) sums[j] += values[i] - origin;
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
}

// Largest squared distance of points (x, y, z) from p.
float farthest(const float* x, const float* y, const float* z, size_t count, const Vec3& p) {
  float most[8] = {};
  size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    float squared[8];
    for (size_t j = 0; j < 8; ++j) {
      const float dx = x[i + j] - p.x, dy = y[i + j] - p.y, dz = z[i + j] - p.z;
      squared[j] = dx * dx + dy * dy + dz * dz;
    }
    for (size_t j = 0; j < 8; ++j) most[j] = squared[j] > most[j] ? squared[j] : most[j];
  }
  for (; i < count; ++i) {
    const float dx = x[i] - p.x, dy = y[i] - p.y, dz = z[i] - p.z;
    most[0] = std::max(most[0], dx * dx + dy * dy + dz * dz);
  }
  return *std::max_element(most, most + 8);
}

// Bound on the length of n_i - n for unit vectors n_i, n being the direction of their mean, from the mean's length: the
// sum of 1 - n_i.n is their number times what that length lacks to 1.
float spread_bound(const Vec3& mean, size_t count) {
  const float lack = std::max(1.0f - glm::length(mean), 0.0f) + gamma_bound(16);
  return std::sqrt(2.0f * float(count) * lack);
}

bool is_far(const LightExtent& light, const Vec3& position, float radius, float widest) {
  return light.kind != LightExtent::Kind::bounded || radius <= widest * glm::length(light.ball.centre - position);
}

}  // namespace

void copy_shading_point(const ShadingPointBatch& from, size_t index, size_t i, ShadingPointBatch& out) {
  using B = ShadingPointBatch;
  for (const auto member :
       {&B::px, &B::py, &B::pz, &B::gx, &B::gy, &B::gz, &B::sx, &B::sy, &B::sz, &B::error, &B::radius}) {
    (out.*member)[i] = (from.*member)[index];
  }
  for (const auto member : {&B::seed, &B::sample, &B::instance}) (out.*member)[i] = (from.*member)[index];
  out.transmits[i] = from.transmits[index];
}

ShadingClusters::Centre ShadingClusters::find_centre(ShadingCluster& cluster) const {
  const size_t first = cluster.begin, count = cluster.size();
  const ShadingPointBatch& p = points;
  Centre c = {at(p.px, p.py, p.pz, first), at(p.gx, p.gy, p.gz, first), at(p.sx, p.sy, p.sz, first), 0.0f,
              p.error[first]};
  if (count == 1) return c;
  const auto mean = [&](const Array& values, float origin) {
    return origin + sum_from(&values[first], count, origin) / float(count);
  };
  c.position = {mean(p.px, c.position.x), mean(p.py, c.position.y), mean(p.pz, c.position.z)};
  const Vec3 facing(mean(p.gx, 0.0f), mean(p.gy, 0.0f), mean(p.gz, 0.0f));
  const Vec3 shading(mean(p.sx, 0.0f), mean(p.sy, 0.0f), mean(p.sz, 0.0f));
  c.facing = direction_of(facing, c.facing);
  c.shading = direction_of(shading, c.shading);
  c.error = *std::max_element(&p.error[first], &p.error[first] + count);
  c.radius = std::sqrt(farthest(&p.px[first], &p.py[first], &p.pz[first], count, c.position)) * (1.0f + gamma_bound(8));
  cluster.spread = std::max(spread_bound(facing, count), spread_bound(shading, count));
  return c;
}

void ShadingClusters::add(std::span<const PathVertex> all, std::span<const LightExtent> lights, float widest,
                          uint32_t begin, uint32_t end) {
  ShadingCluster whole = {begin, end};
  const Centre centre = find_centre(whole);
  const auto far = [&](const LightExtent& light) { return is_far(light, centre.position, centre.radius, widest); };
  const auto is_plain = [&](uint32_t i) { return all[vertices[i]].material->plain_diffuse(); };
  if (whole.size() == 1 || std::all_of(lights.begin(), lights.end(), far)) {
    for (uint32_t i = begin; i < end; ++i) whole.plain_diffuse = whole.plain_diffuse && is_plain(i);
    clusters_.push_back(whole);
    centres_.push_back(centre);
    return;
  }
  for (uint32_t i = begin; i < end; ++i) {
    clusters_.push_back({i, i + 1, 0.0f, is_plain(i)});
    centres_.push_back(find_centre(clusters_.back()));
  }
}

// Pointers are copied, so that the compiler need not reload them after each store.
void ShadingClusters::fill(std::span<const PathVertex> all, std::span<const PathState> paths) {
  const size_t count = vertices.size();
  points.resize(count);
  for (Array* a : {&red, &green, &blue}) a->resize(padded(count));
  ShadingPointBatch& p = points;
  float *px = p.px.data(), *py = p.py.data(), *pz = p.pz.data(), *gx = p.gx.data(), *gy = p.gy.data(),
        *gz = p.gz.data(), *sx = p.sx.data(), *sy = p.sy.data(), *sz = p.sz.data(), *error = p.error.data(),
        *r = red.data(), *g = green.data(), *b = blue.data();
  uint32_t *seed = p.seed.data(), *sample = p.sample.data(), *instance = p.instance.data();
  uint8_t* transmits = p.transmits.data();
  std::fill_n(p.radius.data(), count, 0.0f);
  const Material* material = nullptr;
  Rgb reflected(0.0f);
  bool is_transmitting = false;
  for (size_t i = 0; i < count; ++i) {
    const PathVertex& v = all[vertices[i]];
    const SurfacePoint& at = *v.surface;
    if (v.material != material) {
      material = v.material;
      reflected = material->plain_diffuse() ? material->reflectance / k_pi : Rgb(0.0f);
      is_transmitting = material->transmits();
    }
    px[i] = at.position.x, py[i] = at.position.y, pz[i] = at.position.z;
    gx[i] = v.facing.x, gy[i] = v.facing.y, gz[i] = v.facing.z;
    sx[i] = v.frame.n.x, sy[i] = v.frame.n.y, sz[i] = v.frame.n.z;
    error[i] = at.error;
    seed[i] = v.seed, sample[i] = paths[v.path].index, instance[i] = at.instance;
    transmits[i] = is_transmitting;
    r[i] = reflected.x, g[i] = reflected.y, b[i] = reflected.z;
  }
}

void ShadingClusters::build(std::span<const PathVertex> all, std::span<const PathState> paths,
                            std::span<const LightExtent> lights, float widest, uint32_t most, bool single) {
  clusters_.clear();
  centres_.clear();
  vertices.clear();
  for (uint32_t i = 0; i < all.size(); ++i) {
    const Material& material = *all[i].material;
    if (!material.delta() && !material.dark) vertices.push_back(i);
  }
  const auto instance_of = [&](uint32_t v) { return all[v].surface->instance; };
  const auto seed_of = [&](size_t i) { return all[vertices[i]].seed; };
  const size_t count = vertices.size();
  for (size_t begin = 0, end = 0; begin < count && !single; begin = end) {
    bool is_even = true;
    for (end = begin + 1; end < count && seed_of(end) == seed_of(begin); ++end) {
      is_even = is_even && instance_of(vertices[end]) == instance_of(vertices[begin]);
    }
    if (is_even) continue;
    std::stable_sort(vertices.begin() + std::ptrdiff_t(begin), vertices.begin() + std::ptrdiff_t(end),
                     [&](uint32_t a, uint32_t b) { return instance_of(a) < instance_of(b); });
  }
  fill(all, paths);
  const auto joins = [&](size_t i, size_t first) {
    return points.seed[i] == points.seed[first] && points.instance[i] == points.instance[first] &&
           !points.transmits[i] &&
           glm::dot(at(points.gx, points.gy, points.gz, i), at(points.gx, points.gy, points.gz, first)) > 0.0f;
  };
  for (size_t begin = 0, end = 0; begin < count; begin = end) {
    end = begin + 1;
    while (!single && end < count && end - begin < most && joins(end, begin)) ++end;
    add(all, lights, widest, uint32_t(begin), uint32_t(end));
  }
}

void ShadingClusters::centres(size_t begin, size_t end, ShadingPointBatch& out) const {
  out.resize(end - begin);
  for (size_t i = 0; i < out.size; ++i) {
    const Centre& c = centres_[begin + i];
    copy_shading_point(points, clusters_[begin + i].begin, i, out);
    out.px[i] = c.position.x, out.py[i] = c.position.y, out.pz[i] = c.position.z;
    out.gx[i] = c.facing.x, out.gy[i] = c.facing.y, out.gz[i] = c.facing.z;
    out.sx[i] = c.shading.x, out.sy[i] = c.shading.y, out.sz[i] = c.shading.z;
    out.error[i] = c.error;
    out.radius[i] = c.radius;
    out.sample[i] = 0;
  }
}

}  // namespace fieldtrace
