#include "hybrid/light/shading_clusters.h"

#include <algorithm>

namespace fieldtrace {
namespace {

Vec3 direction_of(const Vec3& sum, const Vec3& otherwise) {
  const float length = glm::length(sum);
  return length > 0.0f ? sum / length : otherwise;
}

void write_point(const Vec3& p, const Vec3& g, const Vec3& s, size_t i, ShadingPointBatch& out) {
  out.px[i] = p.x, out.py[i] = p.y, out.pz[i] = p.z;
  out.gx[i] = g.x, out.gy[i] = g.y, out.gz[i] = g.z;
  out.sx[i] = s.x, out.sy[i] = s.y, out.sz[i] = s.z;
}

bool is_far(const LightExtent& light, const Vec3& position, float radius) {
  return light.kind != LightExtent::Kind::bounded ||
         radius <= k_widest_cluster * glm::length(light.ball.centre - position);
}

}  // namespace

void set_shading_point(const PathVertex& v, uint32_t sample, size_t i, ShadingPointBatch& out) {
  write_point(v.surface->position, v.facing, v.frame.n, i, out);
  out.error[i] = v.surface->error;
  out.radius[i] = 0.0f;
  out.seed[i] = v.seed;
  out.sample[i] = sample;
  out.instance[i] = v.surface->instance;
  out.transmits[i] = v.material->transmits();
}

ShadingClusters::Centre ShadingClusters::centre_of(std::span<const PathVertex> vertices,
                                                   std::span<const uint32_t> members) {
  const PathVertex& first = vertices[members[0]];
  Centre c = {first.surface->position, first.facing, first.frame.n, 0.0f, first.surface->error};
  if (members.size() == 1) return c;
  // Sums of differences: coordinates may be large beside the cluster.
  Vec3 offset(0.0f), facing(0.0f), shading(0.0f);
  for (const uint32_t m : members) {
    const PathVertex& v = vertices[m];
    offset += v.surface->position - first.surface->position;
    facing += v.facing;
    shading += v.frame.n;
    c.error = std::max(c.error, v.surface->error);
  }
  c.position += offset / float(members.size());
  c.facing = direction_of(facing, c.facing);
  c.shading = direction_of(shading, c.shading);
  float squared = 0.0f;
  for (const uint32_t m : members) {
    const Vec3 d = vertices[m].surface->position - c.position;
    squared = std::max(squared, glm::dot(d, d));
  }
  c.radius = std::sqrt(squared) * (1.0f + gamma_bound(8));
  return c;
}

void ShadingClusters::add(std::span<const PathVertex> vertices, std::span<const LightExtent> lights, uint32_t begin,
                          uint32_t end) {
  const ShadingCluster whole = {begin, end};
  const Centre centre = centre_of(vertices, members(whole));
  const bool joins = std::all_of(lights.begin(), lights.end(), [&](const LightExtent& light) {
    return is_far(light, centre.position, centre.radius);
  });
  if (joins || whole.size() == 1) {
    clusters_.push_back(whole);
    centres_.push_back(centre);
    return;
  }
  for (uint32_t i = begin; i < end; ++i) {
    clusters_.push_back({i, i + 1});
    centres_.push_back(centre_of(vertices, members(clusters_.back())));
  }
}

void ShadingClusters::build(std::span<const PathVertex> vertices, std::span<const LightExtent> lights, uint32_t most,
                            bool single) {
  members_.clear();
  clusters_.clear();
  centres_.clear();
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    const Material& material = *vertices[i].material;
    if (!material.delta() && !material.dark) members_.push_back(i);
  }
  const auto instance_of = [&](uint32_t m) { return vertices[m].surface->instance; };
  for (uint32_t begin = 0, end = 0; begin < members_.size(); begin = end) {
    const PathVertex& first = vertices[members_[begin]];
    bool is_even = true;
    for (end = begin + 1; end < members_.size() && vertices[members_[end]].seed == first.seed && !single; ++end) {
      is_even = is_even && instance_of(members_[end]) == instance_of(members_[begin]);
    }
    const auto range_begin = members_.begin() + begin, range_end = members_.begin() + end;
    if (!is_even) {
      std::stable_sort(range_begin, range_end, [&](uint32_t a, uint32_t b) { return instance_of(a) < instance_of(b); });
    }
    for (uint32_t from = begin, to = begin; from < end; from = to) {
      const PathVertex& v = vertices[members_[from]];
      const auto joins = [&](uint32_t m) {
        return !v.material->transmits() && instance_of(m) == v.surface->instance &&
               glm::dot(vertices[m].facing, v.facing) > 0.0f;
      };
      to = from + 1;
      while (to < end && to - from < most && joins(members_[to])) ++to;
      add(vertices, lights, from, to);
    }
  }
}

void ShadingClusters::points(std::span<const PathVertex> vertices, size_t begin, size_t end,
                             ShadingPointBatch& out) const {
  out.resize(end - begin);
  for (size_t i = 0; i < out.size; ++i) {
    const Centre& c = centres_[begin + i];
    set_shading_point(vertices[members_[clusters_[begin + i].begin]], 0, i, out);
    write_point(c.position, c.facing, c.shading, i, out);
    out.error[i] = c.error;
    out.radius[i] = c.radius;
  }
}

}  // namespace fieldtrace
