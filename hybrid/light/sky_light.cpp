#include "hybrid/light/sky_light.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/sampling/sobol.hd.h"
#include "core/simd/vec_lanes.h"
#include "core/surface/surface.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_visibility.hd.h"
#include "hybrid/stats/stopwatch.h"

namespace fieldtrace {
namespace {

// Shading points that share what is set up for a cell.
constexpr size_t k_sky_batch = 256;
// A texel that a footprint is read from, in widths of the cell: a tent and its texel of this width have the variance of
// a box of width 1.
constexpr float k_footprint = 0.58f;
// How far a cell's filter reaches about its centre, in widths: texels are up to sqrt(2) wider, and a bilinear read
// covers one and a half.
constexpr float k_filter_reach = 1.25f;
// Rays to undecided cells, in light samples for their share of the light: they alone bring noise.
const float k_open_gain = std::getenv("FT_SKY_K") ? float(std::atof(std::getenv("FT_SKY_K"))) : 4.0f;
// A sample stream separate from that of the lights, which use the vertex seeds unchanged.
constexpr uint32_t k_sky_stream = 0x534b5900u;

Rgb luminance_weights() { return {0.2126f, 0.7152f, 0.0722f}; }
float luminance(const Rgb& c) { return glm::dot(c, luminance_weights()); }

Vec3 position(const ShadingPointBatch& p, size_t i) { return {p.px[i], p.py[i], p.pz[i]}; }
Vec3 shading(const ShadingPointBatch& p, size_t i) { return {p.sx[i], p.sy[i], p.sz[i]}; }
Vec3 geometric(const ShadingPointBatch& p, size_t i) { return {p.gx[i], p.gy[i], p.gz[i]}; }

// a . (L x + b), of a matrix of twelve columns-first values, times `scale`, plus `shift`, as a row over x.
void write_row(const float m[12], const Vec3& a, float scale, float shift, float row[4]) {
  for (int c = 0; c < 4; ++c) row[c] = scale * (a.x * m[3 * c] + a.y * m[3 * c + 1] + a.z * m[3 * c + 2]);
  row[3] += shift;
}

// Whether some ray from within `from` at most `angle` off the unit `axis` may meet `ball`.
bool meets_cone(const Sphere& ball, const Sphere& from, const Vec3& axis, float angle) {
  const Vec3 to = ball.centre - from.centre;
  const float distance = glm::length(to), reach = ball.radius + from.radius;
  if (distance <= reach) return true;
  const float widest = std::asin(reach / distance) + angle + 1e-4f;
  return widest >= k_pi || glm::dot(to, axis) >= std::cos(widest) * distance;
}

// The width of a cell, radians.
float cell_width(int directions) { return 2.0f * std::sqrt(k_pi) / float(directions); }

MapLines lines_of(const SkyOccluder& o, const SkyMaps& sky, int cell, const Vec3& unit) {
  const Mat3& frame = sky.frame(cell);  // s, t, c
  const float half_texels = 0.5f * float(o.view.texels), along = glm::dot(frame[2], unit);
  MapLines lines;
  write_row(o.to_unit, frame[0], half_texels, half_texels, lines.u);
  write_row(o.to_unit, frame[1], half_texels, half_texels, lines.v);
  write_row(o.to_unit, frame[2], 1.0f, 0.0f, lines.z);
  lines.slope_u = half_texels * glm::dot(frame[0], unit) / along;
  lines.slope_v = half_texels * glm::dot(frame[1], unit) / along;
  lines.reach = k_footprint * cell_width(sky.directions()) * half_texels / along;
  lines.margin = sky.tolerance().margin / half_texels;
  lines.depth_begin = cell * o.view.depth_bytes;
  lines.coverage_begin = cell * o.view.coverage_bytes;
  lines.maps = &o.view;
  return lines;
}

PlaneLines plane_lines(const SkyOccluder& o, const Vec3& d) {
  const float* const m = o.to_unit;
  const auto row = [&](int r) { return Vec3(m[r], m[3 + r], m[6 + r]); };
  PlaneLines lines;
  write_row(m, {1, 0, 0}, 1.0f, 0.0f, lines.x);
  write_row(m, {0, 1, 0}, 1.0f, 0.0f, lines.y);
  const float per_unit = 1.0f / glm::length(row(2));
  write_row(m, {0, 0, 1}, per_unit, 0.0f, lines.height);
  lines.dx = glm::dot(row(0), d), lines.dy = glm::dot(row(1), d);
  lines.rise = glm::dot(row(2), d) * per_unit;
  lines.per_unit_x = glm::dot(row(0), row(0)), lines.per_unit_y = glm::dot(row(1), row(1));
  return lines;
}

}  // namespace

void SkyLight::add_map(const SkyOccluder& o) {
  const SkyMaps& sky = *context_.sky;
  const Vec3 to = o.ball.centre - ball_.centre;
  const float distance = glm::length(to), reach = o.ball.radius + ball_.radius;
  const float width = cell_width(sky.directions());
  // Cells beyond the cone read nothing.
  float least = -2.0f;
  if (distance > reach) {
    const float angle = std::asin(reach / distance) + k_filter_reach * width;
    least = angle < k_pi ? std::cos(angle) * distance : -2.0f * distance;
  } else {
    least = -k_infinity;
  }
  const Mat3 to_grid = glm::transpose(o.grid);
  for (size_t k = 0; k < lit_.size(); ++k) {
    const Vec3 d = grid_ * sky.frame(int(lit_[k]))[2];
    if (glm::dot(d, to) < least) continue;
    switch (o.kind) {
      case SkyOccluder::Kind::map: {
        const Vec3 unit = to_grid * d;
        maps_[k].push_back(lines_of(o, sky, sky.cell_at(unit), unit));
        break;
      }
      case SkyOccluder::Kind::plane:
        planes_[k].push_back(plane_lines(o, d));
        break;
      case SkyOccluder::Kind::ball:
        balls_[k].push_back({{o.ball.centre.x, o.ball.centre.y, o.ball.centre.z}, o.ball.radius});
        break;
      case SkyOccluder::Kind::none:
        break;
    }
  }
}

void SkyLight::find_occluders(const Job&, uint32_t instance) {
  const SkyMaps& sky = *context_.sky;
  const float width = cell_width(sky.directions());
  lit_.clear();
  // Below this, the direction is under the horizons of all points by more than half a cell.
  const float half = std::min(width, 0.5f * k_pi);
  const float sine = normal_sine_ * std::cos(half) + normal_cosine_ * std::sin(half);
  const bool all = normal_cosine_ < std::sin(half);
  for (int cell = 0; cell < sky.directions() * sky.directions(); ++cell) {
    if (all || glm::dot(grid_ * sky.frame(cell)[2], mean_normal_) > -sine) lit_.push_back(uint32_t(cell));
  }
  const size_t most = size_t(sky.directions()) * size_t(sky.directions());
  maps_.resize(most), planes_.resize(most), balls_.resize(most);
  for (size_t k = 0; k < lit_.size(); ++k) maps_[k].clear(), planes_[k].clear(), balls_[k].clear();
  for (const SkyOccluder& o : sky.occluders()) {
    if (o.instance == instance && (o.is_flat || o.kind != SkyOccluder::Kind::ball)) continue;
    add_map(o);
  }
}

void SkyLight::see_cells(const Job& job, uint32_t instance) {
  const SkyMaps& sky = *context_.sky;
  const SkyOccluder& self = sky.occluders()[instance];
  const bool has_own = self.kind == SkyOccluder::Kind::map && !self.is_flat;
  const CellKernel kernel = cell_kernel_for(context_.settings.isa);
  const float solid_angle = 4.0f * k_pi / float(sky.directions() * sky.directions());
  const CellPoints points = {centres_.px.data(), centres_.py.data(), centres_.pz.data(),
                             centres_.gx.data(), centres_.gy.data(), centres_.gz.data(),
                             centres_.sx.data(), centres_.sy.data(), centres_.sz.data(), int32_t(padded_size_)};
  const CellSums sums = {red_.data(), green_.data(), blue_.data()};
  undecided_.resize(padded_size_ + k_batch_padding);
  open_cells_.clear();
  for (size_t k = 0; k < lit_.size(); ++k) {
    const size_t cell = lit_[k];
    if (!has_own && maps_[k].empty() && planes_[k].empty() && balls_[k].empty()) continue;
    const Mat3& frame = sky.frame(int(cell));
    const Vec3 d = grid_ * frame[2];
    CellTask task;
    OwnLines own;
    if (has_own) {
      own.lines = lines_of(self, sky, int(cell), frame[2]);
      own.clear_within = sky.tolerance().clear_within;
      own.hidden_from = sky.tolerance().hidden_from;
      const Vec3 s = grid_ * frame[0], t = grid_ * frame[1];
      for (int a = 0; a < 3; ++a) own.s[a] = s[a], own.t[a] = t[a], own.c[a] = d[a];
      task.own = &own;
    }
    const Vec3 vector(cells_->vx[cell], cells_->vy[cell], cells_->vz[cell]);
    const Rgb radiance(cells_->red[cell], cells_->green[cell], cells_->blue[cell]);
    for (int a = 0; a < 3; ++a) {
      task.direction[a] = d[a];
      task.vector[a] = vector[a];
      task.weight[a] = radiance[a] * solid_angle;
    }
    task.half = 0.5f * cell_width(sky.directions());
    task.cosine_half = cells_->half_width;
    task.maps = maps_[k].data(), task.map_count = int(maps_[k].size());
    task.planes = planes_[k].data(), task.plane_count = int(planes_[k].size());
    task.balls = balls_[k].data(), task.ball_count = int(balls_[k].size());
    const int open = kernel(task, points, sums, undecided_.data());
    const float light = luminance(radiance) * solid_angle;
    for (int i = 0; i < open; ++i) {
      const auto point = uint32_t(undecided_[size_t(i)]);
      if (point >= centres_.size) break;
      const float cosine =
          scalar::cosine_over_cell<float>(glm::dot(vector, shading(centres_, point)), cells_->half_width);
      open_cells_.push_back({point, uint32_t(cell), cosine * light});
    }
  }
  job.stats.lookups += lit_.size() * centres_.size;
}

// By point, keeping the order otherwise.
void SkyLight::sort_open_cells() {
  open_begin_.assign(centres_.size + 1, 0);
  for (const OpenCell& open : open_cells_) ++open_begin_[open.point + 1];
  std::partial_sum(open_begin_.begin(), open_begin_.end(), open_begin_.begin());
  sorted_cells_.resize(open_cells_.size());
  for (const OpenCell& open : open_cells_) sorted_cells_[open_begin_[open.point]++] = open;
  open_cells_.swap(sorted_cells_);
}

// Draws the rays of each point's open cells.
void SkyLight::sample_open_cells(const Job& job, std::span<const uint32_t> clusters) {
  const SkyMaps& sky = *context_.sky;
  const int side = sky.directions();
  const float solid_angle = 4.0f * k_pi / float(side * side);
  sort_open_cells();
  cell_rays_.clear();
  const ShadingPointBatch& all = job.receivers.points;
  std::vector<float> sums;
  for (size_t begin = 0, end = 0; begin < open_cells_.size(); begin = end) {
    const uint32_t point = open_cells_[begin].point;
    const ShadingCluster& cluster = job.clusters[clusters[point]];
    sums.assign(1, 0.0f);
    for (end = begin; end < open_cells_.size() && open_cells_[end].point == point; ++end) {
      sums.push_back(sums.back() + open_cells_[end].weight);
    }
    const float total = sums.back();
    if (!(total > 0.0f)) continue;
    const Vec3 n = shading(centres_, point);
    const float open_sky = std::max(luminance(sky.radiance().irradiance(n)), total);
    const auto samples = float(cluster.size()) * float(job.light_samples);
    const int count = int(std::ceil(samples * std::min(k_open_gain * total / open_sky, 1.0f)));
    const uint32_t seed = scalar::hash_combine(centres_.seed[point], k_sky_stream);
    const float offset = scalar::sample_2d(0, seed, 2).x;
    for (int k = 0; k < count; ++k) {
      const auto in_cell = scalar::sample_2d(uint32_t(k), seed, 0);
      const float at = (float(k) + offset) / float(count) * total;
      const auto place = std::upper_bound(sums.begin() + 1, sums.end() - 1, at) - sums.begin() - 1;
      const OpenCell& open = open_cells_[begin + size_t(place)];
      const auto u = float(open.cell / uint32_t(side)), v = float(open.cell % uint32_t(side));
      const auto in_square = [&](float cell, float x) { return (cell + x) * 2.0f / float(side) - 1.0f; };
      const Vec3 d =
          grid_ * to_vec(scalar::frame_from_square<float>(in_square(u, in_cell.x), in_square(v, in_cell.y)).c);
      const size_t from = cluster.begin + size_t(k) % cluster.size();
      const float cosine = glm::dot(n, d);
      const Rgb radiance(cells_->red[open.cell], cells_->green[open.cell], cells_->blue[open.cell]);
      const Rgb irradiance = radiance * (std::max(cosine, 0.0f) * solid_angle * total / (open.weight * float(count)));
      if (!(cosine > 0.0f) || !(glm::dot(d, geometric(all, from)) > 0.0f)) continue;
      const Vec3 origin = offset_origin(position(all, from), geometric(all, from), all.error[from], d);
      if (rays_.ox.size() <= cell_rays_.size()) rays_.resize(2 * cell_rays_.size() + k_batch_padding);
      rays_.set(cell_rays_.size(), origin, d, k_infinity);
      cell_rays_.push_back({point, irradiance});
    }
  }
}

void SkyLight::trace(const Job& job) {
  const size_t count = cell_rays_.size();
  ray_indices_.resize(count);
  std::iota(ray_indices_.begin(), ray_indices_.end(), 0u);
  blocked_.assign(padded(count), 0);
  rays_.resize(count);
  context_.accel.occluded(rays_, ray_indices_, blocked_.data());
  job.stats.rays_exact += count;
  job.stats.rays_crossing += count;
  job.stats.rays_shadow += count;
  for (size_t i = 0; i < count; ++i) {
    if (blocked_[i]) continue;
    const CellRay& ray = cell_rays_[i];
    red_[ray.point] += ray.irradiance.x, green_[ray.point] += ray.irradiance.y, blue_[ray.point] += ray.irradiance.z;
  }
}

void SkyLight::gather_batch(const Job& job, std::span<const uint32_t> clusters) {
  const SkyMaps& sky = *context_.sky;
  const size_t count = clusters.size();
  padded_size_ = padded(count);
  const uint32_t instance = centres_.instance[0];
  Bounds3 bounds;
  Vec3 sum(0.0f);
  for (size_t i = 0; i < count; ++i) bounds.extend(position(centres_, i)), sum += shading(centres_, i);
  for (size_t i = count; i < padded_size_; ++i) centres_.copy(i, centres_, 0, 1);
  ball_ = {bounds.centre(), 0.5f * glm::length(bounds.diagonal())};
  mean_normal_ = glm::length(sum) > 0.0f ? glm::normalize(sum) : Vec3(0.0f, 0.0f, 1.0f);
  normal_cosine_ = 1.0f;
  for (size_t i = 0; i < count; ++i) {
    normal_cosine_ = std::min(normal_cosine_, glm::dot(mean_normal_, shading(centres_, i)));
  }
  normal_cosine_ = std::max(normal_cosine_ - 1e-4f, -1.0f);
  normal_sine_ = std::sqrt(1.0f - normal_cosine_ * normal_cosine_);
  cells_ = &sky.cells_of(instance);
  grid_ = sky.grid_of(instance);
  for (auto* v : {&red_, &green_, &blue_}) v->assign(padded_size_, 0.0f);
  find_occluders(job, instance);
  see_cells(job, instance);
  for (size_t i = 0; i < count; ++i) {
    const Rgb open = sky.radiance().irradiance(shading(centres_, i));
    red_[i] = open.x - red_[i], green_[i] = open.y - green_[i], blue_[i] = open.z - blue_[i];
  }
  sample_open_cells(job, clusters);
  trace(job);
  for (size_t i = 0; i < count; ++i) {
    const ShadingCluster& c = job.clusters[clusters[i]];
    const Rgb e = glm::max(Rgb(red_[i], green_[i], blue_[i]), Rgb(0.0f));
    LightReceivers& r = job.receivers;
    for (size_t k = c.begin; k < c.end; ++k) {
      r.arriving_red[k] += e.x * r.red[k];
      r.arriving_green[k] += e.y * r.green[k];
      r.arriving_blue[k] += e.z * r.blue[k];
    }
    const uint64_t samples = uint64_t(c.size()) * uint64_t(job.light_samples);
    job.stats.samples += samples;
  }
  add_concentrated(job, clusters);
}

// Whether anything may hide some of the concentrated source from some of a cluster.
bool SkyLight::may_hide_concentrated(uint32_t point) const {
  const SkyRadiance& sky = context_.sky->radiance();
  const Vec3 p = position(centres_, point);
  return std::any_of(hiding_.begin(), hiding_.end(), [&](const SkyOccluder* o) {
    return meets_cone(o->ball, {p, centres_.radius[point]}, sky.concentrated_axis(), sky.concentrated_angle());
  });
}

void SkyLight::add_concentrated(const Job& job, std::span<const uint32_t> clusters) {
  const SkyMaps& sky = *context_.sky;
  if (!sky.radiance().concentrated()) return;
  hiding_.clear();
  for (const SkyOccluder& o : sky.occluders()) {
    if (o.instance == centres_.instance[0] && o.is_flat) continue;
    if (meets_cone(o.ball, ball_, sky.radiance().concentrated_axis(), sky.radiance().concentrated_angle())) {
      hiding_.push_back(&o);
    }
  }
  open_clusters_.clear(), hidden_clusters_.clear();
  for (uint32_t i = 0; i < clusters.size(); ++i) {
    (may_hide_concentrated(i) ? hidden_clusters_ : open_clusters_).push_back(clusters[i]);
  }
  add_concentrated_to(job, open_clusters_, false);
  add_concentrated_to(job, hidden_clusters_, true);
}

void SkyLight::add_concentrated_to(const Job& job, std::span<const uint32_t> clusters, bool may_be_hidden) {
  const LightTable& table = *context_.sky->radiance().concentrated();
  const Light& light = table.lights[0];
  const Rgb value = Rgb(light.value[0], light.value[1], light.value[2]) / float(job.light_samples);
  const size_t m = size_t(job.light_samples), most = std::max(k_sky_batch * 16 / m, size_t(1));
  LightReceivers& r = job.receivers;
  for (size_t next = 0; next < clusters.size();) {
    const size_t first = next;
    size_t count = 0;
    do {
      count += job.clusters[clusters[next]].size();
    } while (++next < clusters.size() && count < most);
    selected_.resize(count);
    count = 0;
    for (size_t i = first; i < next; ++i) {
      const ShadingCluster& c = job.clusters[clusters[i]];
      selected_.copy(count, r.points, c.begin, c.size());
      count += c.size();
    }
    sample_light(table, 0, selected_, job.light_samples, context_.settings.isa, shadows_);
    job.stats.rays_shadow += shadows_.active;
    if (may_be_hidden) {
      ray_indices_.clear();
      for (uint32_t i = 0; i < shadows_.rays.size; ++i) {
        if (shadows_.rays.tmax[i] >= 0.0f) ray_indices_.push_back(i);
      }
      context_.accel.occluded(shadows_.rays, ray_indices_, shadows_.blocked.data());
      job.stats.rays_exact += ray_indices_.size();
      job.stats.rays_crossing += ray_indices_.size();
    }
    size_t slot = 0;
    for (size_t i = first; i < next; ++i) {
      const ShadingCluster& c = job.clusters[clusters[i]];
      for (size_t k = c.begin; k < c.end; ++k) {
        Rgb sum(0.0f);
        for (const size_t end = slot + m; slot < end; ++slot) {
          if (shadows_.rays.tmax[slot] < 0.0f || shadows_.blocked[slot]) continue;
          sum += Rgb(shadows_.red[slot], shadows_.green[slot], shadows_.blue[slot]) * shadows_.weight[slot];
        }
        sum *= value;
        r.arriving_red[k] += sum.x * r.red[k];
        r.arriving_green[k] += sum.y * r.green[k];
        r.arriving_blue[k] += sum.z * r.blue[k];
      }
    }
  }
}

void SkyLight::gather(const ShadingClusters& clusters, LightReceivers& receivers, int light_samples,
                      std::span<FirstHit> firsts, Stats& stats) {
  const ScopedTimer timer(stats.time_secondary);
  Job job{clusters, receivers, light_samples, firsts, stats};
  std::vector<uint32_t> diffuse;
  for (uint32_t c = 0; c < clusters.size(); ++c) {
    if (clusters[c].plain_diffuse) diffuse.push_back(c);
  }
  ShadingPointBatch centres;
  clusters.centres(0, clusters.size(), centres);
  std::stable_sort(diffuse.begin(), diffuse.end(),
                   [&](uint32_t a, uint32_t b) { return centres.instance[a] < centres.instance[b]; });
  for (size_t begin = 0, end = 0; begin < diffuse.size(); begin = end) {
    for (end = begin; end < diffuse.size() && end - begin < k_sky_batch &&
                      centres.instance[diffuse[end]] == centres.instance[diffuse[begin]];) {
      ++end;
    }
    const std::span<const uint32_t> batch = std::span(diffuse).subspan(begin, end - begin);
    centres_.resize(padded(batch.size()));
    for (size_t i = 0; i < batch.size(); ++i) centres_.copy(i, centres, batch[i], 1);
    centres_.size = batch.size();
    gather_batch(job, batch);
  }
}

}  // namespace fieldtrace
