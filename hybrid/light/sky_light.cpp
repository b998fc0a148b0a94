#include "hybrid/light/sky_light.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "core/platform/stopwatch.h"
#include "core/sampling/sobol.hd.h"
#include "core/surface/surface.h"
#include "field/bake/cell_lines.h"
#include "field/maps/cell_visibility.hd.h"
#include "hybrid/light/group_light.h"

namespace fieldtrace {
namespace {

// Shading points that share what is set up for a cell.
constexpr size_t k_sky_batch = 256;
// Clusters whose normals spread more (ShadingCluster::spread) are lit at so many of their points, or at twice as many.
constexpr float k_widest_spread = 0.25f;
constexpr uint32_t k_wide_cluster_points = 32;
// So are those that a lens blurs by more than this share of the median object's radius.
constexpr float k_widest_blur = 0.25f;
// How far what was asked for may lie from its fit, for each unit of tolerance, in units of the open sky.
constexpr float k_fit_tolerance = 0.05f;
// Rays to undecided cells, for each light sample that Monte Carlo would send to them.
constexpr float k_open_cell_rays = 8.0f;
// Least cosine, in half widths of a cell, that an undecided cell's rays are drawn by.
constexpr float k_least_cosine = 0.25f;

// The radius, in world space and across the view, over which the lens spreads a pixel that sees a point.
float blur_at(const Camera& camera, const Vec3& point) {
  if (!(camera.aperture_radius > 0.0f)) return 0.0f;
  const Vec3 axis = camera.to_world[2];  // as long as a unit of the camera's
  const float depth = glm::dot(point - camera.to_world[3], axis) / glm::dot(axis, axis);
  return glm::length(axis) * camera.aperture_radius * std::abs(depth / camera.focus_distance - 1.0f);
}

}  // namespace

Vec3 SkyLight::direction_in(uint32_t cell, float x, float y) const {
  const SkyCell& c = light_->cells[cell];
  return grid_ * direction_in_cell(c.u, c.v, x, y, c.side);
}

// Of the batch's points.
CellSums SkyLight::clear_sums() {
  for (auto* v : {&red_, &green_, &blue_, &reflected_red_, &reflected_green_, &reflected_blue_}) {
    v->assign(padded(centres_.size), 0.0f);
  }
  open_cells_.clear();
  return {red_.data(),           green_.data(),           blue_.data(),
          reflected_red_.data(), reflected_green_.data(), reflected_blue_.data()};
}

void SkyLight::see_cells(const Job& job) {
  const CellSums sums = clear_sums();
  job.stats.lookups += occluders_.see(
      context_.settings.isa, cell_points(centres_, grazing_), sums, cell_scratch_,
      [&](const CellTask& task, size_t k, uint32_t i) { add_open_cell(task, occluders_.cells()[k], i); });
}

void SkyLight::add_open_cell(const CellTask& task, uint32_t cell, uint32_t point) {
  const float width = light_->cells[cell].width(), solid_angle = width * width;
  const float reflected = sky_->indirect() ? sky_->indirect()->mean_luminance() : 0.0f;
  const float light = luminance({task.weight[0], task.weight[1], task.weight[2]}) + reflected * solid_angle;
  const Vec3 vector(task.vector[0], task.vector[1], task.vector[2]);
  const float cosine =
      scalar::cosine_over_cell<float>(glm::dot(vector, centres_.shading_normal(point)), task.cosine_half);
  // Parts of cells across the horizon have cosines far above the mean.
  open_cells_.push_back({point, cell, std::max(cosine, k_least_cosine * task.cosine_half) * light});
}

// By point, keeping the order otherwise.
void SkyLight::sort_open_cells() {
  open_begin_.assign(centres_.size + 1, 0);
  for (const OpenCell& open : open_cells_) ++open_begin_[open.point + 1];
  std::partial_sum(open_begin_.begin(), open_begin_.end(), open_begin_.begin());
  sorted_cells_.resize(open_cells_.size());
  std::vector<uint32_t> next(open_begin_.begin(), open_begin_.end());
  for (const OpenCell& open : open_cells_) sorted_cells_[next[open.point]++] = open;
  open_cells_.swap(sorted_cells_);
}

void SkyLight::sample_open_cells(const Job& job) {
  sort_open_cells();
  ray_counts_.assign(centres_.size, 0);
  for (size_t i = 0; i < centres_.size; ++i) {
    const std::span<const OpenCell> cells =
        std::span(open_cells_).subspan(open_begin_[i], open_begin_[i + 1] - open_begin_[i]);
    if (!cells.empty()) sample_cells_of(job, cells);
  }
}

Vec3 SkyLight::ray_origin(const ShadingPointBatch& points, size_t i, const Vec3& d) {
  return offset_origin(points.position(i), points.geometric_normal(i), points.error[i], d);
}

// The receiver whose sample a ray of a point is; `at`: where in the cluster, [0, 1).
uint32_t SkyLight::receiver_of_ray(const Job& job, size_t point, float at) {
  const ShadingCluster& cluster = job.clusters[point];
  return cluster.begin + std::min(uint32_t(at * float(cluster.size())), cluster.size() - 1);
}

// The receiver that it leaves from.
size_t SkyLight::start_of_ray(const Job& job, size_t point, float at) const {
  const uint32_t own = own_points_[job.numbers[point]];
  return own != k_none ? own : receiver_of_ray(job, point, at);
}

// Draws the rays of one point.
void SkyLight::sample_cells_of(const Job& job, std::span<const OpenCell> cells) {
  const uint32_t point = cells[0].point;
  const ShadingCluster& cluster = job.clusters[point];
  const ShadingPointBatch& all = job.receivers.points;
  weight_sums_.clear();
  float total = 0.0f;
  for (const OpenCell& open : cells) weight_sums_.push_back(total += open.weight);
  if (!(total > 0.0f)) return;
  const Vec3 n = centres_.shading_normal(point);
  const float whole = std::max(open_[point], total);
  const float samples = float(cluster.size()) * float(job.light_samples);
  const int count = int(std::ceil(samples * std::min(k_open_cell_rays * (total / whole), 1.0f)));
  // Rays of later samples of a pixel are others.
  const uint32_t seed = scalar::hash_combine(centres_.seed[point], k_sky_stream + all.sample[cluster.begin]);
  const float offset = scalar::sample_2d(0, seed, 1).x;
  ray_counts_[point] = uint32_t(count);
  for (int k = 0; k < count; ++k) {
    // Below all sums of cells without weight at the end.
    const float at = std::min((float(k) + offset) / float(count) * total, std::nextafter(total, 0.0f));
    const auto place = std::upper_bound(weight_sums_.begin(), weight_sums_.end() - 1, at) - weight_sums_.begin();
    const OpenCell& open = cells[size_t(place)];
    const auto in_cell = scalar::sample_2d(uint32_t(k), seed, 0);
    const Vec3 d = direction_in(open.cell, in_cell.x, in_cell.y);
    // Whatever the order of the cells, each part of the cluster gets as many rays to each part of them.
    const float in_cluster = scalar::sample_2d(uint32_t(k), seed, 2).x;
    const size_t from = start_of_ray(job, point, in_cluster);
    const float cosine = glm::dot(n, d);
    if (!(cosine > 0.0f && glm::dot(d, all.geometric_normal(from)) > 0.0f)) continue;
    if (rays_.ox.size() <= cell_rays_.size()) rays_.resize(2 * cell_rays_.size() + k_batch_padding);
    rays_.set(cell_rays_.size(), ray_origin(all, from, d), d, sky_->distance());
    const float width = light_->cells[open.cell].width(), solid_angle = width * width;
    const float received = scalar::weight_of_cosine<float>(cosine, grazing_);
    cell_rays_.push_back({point, receiver_of_ray(job, point, in_cluster),
                          received * solid_angle * total / (open.weight * float(count))});
    if (cell_rays_.size() == size_t(k_shadow_batch)) trace(job);
  }
}

void SkyLight::trace(const Job& job) {
  const size_t count = cell_rays_.size();
  blocked_.assign(padded(count), 0);
  rays_.resize(count);
  if (sky_->indirect()) {
    hits_.resize(count);
    context_.accel.intersect(rays_, hits_, Coherence::incoherent);
    for (size_t i = 0; i < count; ++i) blocked_[i] = hits_.instance[i] != k_none;
  } else {
    ray_indices_.resize(count);
    std::iota(ray_indices_.begin(), ray_indices_.end(), 0u);
    context_.accel.occluded(rays_, ray_indices_, blocked_.data());
  }
  job.stats.rays_exact += count;
  job.stats.rays_crossing += count;
  job.stats.rays_shadow += count;
  add_rays();
  cell_rays_.clear();
}

// Adds what the rays bring, of the sky or of what they meet.
void SkyLight::add_rays() {
  for (size_t i = 0; i < cell_rays_.size(); ++i) {
    const CellRay& ray = cell_rays_[i];
    const Vec3 d = rays_.direction(i);
    if (!blocked_[i]) {
      const Rgb e = sky_->radiance().radiance(d) * ray.weight;
      red_[ray.point] += e.x, green_[ray.point] += e.y, blue_[ray.point] += e.z;
      by_rays_[ray.receiver] += e;
    } else if (sky_->indirect()) {
      const Vec3 origin = rays_.origin(i), position = origin + d * hits_.t[i];
      const Rgb e = sky_->indirect()->radiance(hits_.instance[i], position, origin, d) * ray.weight;
      reflected_red_[ray.point] += e.x, reflected_green_[ray.point] += e.y, reflected_blue_[ray.point] += e.z;
      by_rays_[ray.receiver] += e;
    }
  }
}

// Keeps what arrives at the points of a batch.
void SkyLight::keep_arrivals(const Job& job) {
  for (size_t i = 0; i < centres_.size; ++i) {
    const uint32_t c = job.numbers[i];
    const Rgb of_sky = glm::max(Rgb(red_[i], green_[i], blue_[i]), Rgb(0.0f)), open = open_irradiance_[c];
    const auto share = [](float part, float whole) { return whole > 0.0f ? part / whole : 0.0f; };
    arrivals_[c].values = {share(of_sky.x, open.x),   share(of_sky.y, open.y),     share(of_sky.z, open.z),
                           reflected_red_[i] / unit_, reflected_green_[i] / unit_, reflected_blue_[i] / unit_};
    traced_[c] = ray_counts_[i];
  }
}

void SkyLight::add_irradiance(const Job& job) {
  LightReceivers& r = job.receivers;
  const float sky_share = 1.0f - sky_->radiance().concentrated_share();
  for (size_t i = 0; i < clusters_.size(); ++i) {
    const ShadingCluster& c = clusters_[i];
    const auto& v = arrivals_[i].values;
    const Rgb of_sky = open_irradiance_[i] * Rgb(v[0], v[1], v[2]);
    const Rgb e = of_sky + unit_ * Rgb(v[3], v[4], v[5]);
    // Where some points stand for all, what a plastic reflects there goes with what arrives: seen at grazing angles it
    // is darker. Textures do not go with the light; the mean of all points has less of their noise.
    const uint32_t own = c.plain_diffuse() ? k_none : own_points_[i];
    // Each sample has the noise of its own rays, so that how much samples differ tells the noise of their mean.
    const bool has_rays = traced_[i] > 0 && !fitted_[i];
    Rgb by_rays(0.0f);
    for (size_t k = c.begin; has_rays && k < c.end; ++k) by_rays += by_rays_[k];
    for (size_t k = c.begin; k < c.end; ++k) {
      const size_t at = own == k_none ? k : own;
      const Rgb arriving = has_rays ? e + (float(c.size()) * by_rays_[k] - by_rays) : e;
      r.arriving_red[k] += arriving.x * r.red[at], r.arriving_green[k] += arriving.y * r.green[at];
      r.arriving_blue[k] += arriving.z * r.blue[at];
    }
    if (sky_->radiance().is_black()) continue;  // no light samples are spared
    const uint64_t samples = uint64_t(c.size()) * uint64_t(job.light_samples);
    const uint64_t traced = std::min(samples, uint64_t(traced_[i]));
    job.stats.samples += samples;
    job.stats.samples_spared += samples - traced;
    job.stats.samples_by_strata += samples - traced;
    if (job.firsts.empty()) continue;
    // As many rays as light samples, of the weight that light samples give them.
    const float open = std::max(luminance(open_irradiance_[i]), 1e-30f);
    const float count = sky_share * float(job.light_samples), clear = std::min(luminance(of_sky) / open, 1.0f);
    for (size_t k = c.begin; k < c.end; ++k) {
      FirstHit& first = job.firsts[r.path[k]];
      first.shadow_rays += count;
      first.shadow_clear += count * clear;
      first.shadow_exact += count * float(traced) / float(samples);
    }
  }
}

// The grid and its light, as centres_ see them.
void SkyLight::begin_batch() {
  grid_ = sky_->maps().occluders()[centres_.instance[0]].cells;
  light_ = &sky_->cells_of(centres_.instance[0]);
}

// Finds what arrives at centres_ of the sky's cells.
void SkyLight::see_batch(const Job& job) {
  begin_batch();
  occluders_.find(*sky_, centres_, job.place);
  see_cells(job);
  finish_batch(job);
}

// Once the cells' sums are known.
void SkyLight::finish_batch(const Job& job) {
  open_.resize(centres_.size);
  for (size_t i = 0; i < centres_.size; ++i) open_[i] = luminance(open_irradiance_[job.numbers[i]]);
  enclosed_.scale(*sky_, centres_, open_, context_.settings.isa, {red_.data(), green_.data(), blue_.data()});
  for (size_t i = 0; i < centres_.size; ++i) {
    const Rgb open = open_irradiance_[job.numbers[i]];
    red_[i] = open.x - red_[i], green_[i] = open.y - green_[i], blue_[i] = open.z - blue_[i];
  }
  sample_open_cells(job);
  trace(job);
}

// Sets what the bodies of a cluster's plastics reflect. Returns their CellPoints::grazing.
float SkyLight::light_bodies(const ShadingCluster& cluster, std::span<const PathVertex> vertices,
                             LightReceivers& receivers) const {
  float grazing = 0.0f;
  for (uint32_t i = cluster.begin; i < cluster.end; ++i) {
    const PathVertex& vertex = vertices[receivers.vertex[i]];
    const CoatedBody body = coated_body(*vertex.material, vertex.wi.z);
    receivers.red[i] = body.reflected.x, receivers.green[i] = body.reflected.y, receivers.blue[i] = body.reflected.z;
    if (i == cluster.begin) grazing = body.grazing;
  }
  return grazing;
}

// One point stands for a cluster whose normals hardly differ and that is in focus; for others, some of their own.
void SkyLight::choose_points(const ShadingClusters& clusters, LightReceivers& receivers,
                             std::span<const PathVertex> vertices) {
  const ShadingPointBatch& centres = clusters.centres();
  clusters_.clear();
  grazing_of_.clear(), own_points_.clear();
  points_.resize(receivers.size());
  const float widest = k_widest_blur * sky_->maps().median_radius();
  float grazing = 0.0f, radius = 0.0f;
  const auto add = [&](const ShadingCluster& part, const ShadingPointBatch& from, size_t i) {
    points_.copy(clusters_.size(), from, i);
    clusters_.push_back(part);
    grazing_of_.push_back(grazing);
    own_points_.push_back(&from == &centres ? k_none : uint32_t(i));
    // A point of a cluster's own is no farther from the cluster's others than this.
    if (&from != &centres) points_.radius[clusters_.size() - 1] = 2.0f * radius;
  };
  for (size_t c = 0; c < clusters.size(); ++c) {
    const ShadingCluster& cluster = clusters[c];
    if (cluster.kind == ReceiverKind::other) continue;
    radius = centres.radius[c];
    grazing = cluster.plain_diffuse() ? 0.0f : light_bodies(cluster, vertices, receivers);
    if (cluster.mean_spread() <= k_widest_spread && blur_at(context_.scene.camera, centres.position(c)) <= widest) {
      add(cluster, centres, c);
      continue;
    }
    // The first samples of a sequence are spread evenly, every n-th is not. Each sequence has points of its own.
    const auto& seed = receivers.points.seed;
    for (uint32_t begin = cluster.begin, end = begin; begin < cluster.end; begin = end) {
      while (end < cluster.end && seed[end] == seed[begin]) ++end;
      const uint32_t each = std::max((end - begin) / k_wide_cluster_points, 1u);
      ShadingCluster part = cluster;
      for (uint32_t k = 0; begin + k * each < end; ++k) {
        part.begin = begin + k * each, part.end = std::min(part.begin + each, end);
        add(part, receivers.points, begin + k);
      }
    }
  }
  const size_t count = clusters_.size();
  points_.size = count;
  places_.resize(count), open_irradiance_.resize(count);
  for (size_t i = 0; i < count; ++i) {
    places_[i] = sky_->maps().place(points_.instance[i], points_.position(i));
    // Neighbours on floors and walls have one normal.
    const bool as_before =
        i > 0 && points_.shading_normal(i) == points_.shading_normal(i - 1) && grazing_of_[i] == grazing_of_[i - 1];
    open_irradiance_[i] =
        as_before ? open_irradiance_[i - 1] : sky_->radiance().irradiance(points_.shading_normal(i), grazing_of_[i]);
  }
  arrivals_.assign(count, {}), fitted_.assign(count, 0), traced_.assign(count, 0);
  by_rays_.assign(receivers.size(), Rgb(0.0f));
}

// Chooses which points are asked for first: all, if receivers have no pixels.
void SkyLight::find_blocks(const LightReceivers& receivers, std::span<const PixelPosition> pixels) {
  wanted_.resize(clusters_.size());
  std::iota(wanted_.begin(), wanted_.end(), 0u);
  if (pixels.empty()) return;
  pixels_.clear(), groups_.clear();
  uint32_t group = 0;
  for (uint32_t i = 0; i < clusters_.size(); ++i) {
    pixels_.push_back(pixels[receivers.path[clusters_[i].begin]]);
    if (points_.instance[i] != points_.instance[group] || grazing_of_[i] != grazing_of_[group]) group = i;
    groups_.push_back(own_points_[i] != k_none ? k_none : group);
  }
  // What hides within a distance does so over no more than that distance.
  blocks_.find(points_, pixels_, groups_, sky_->distance(), wanted_);
}

void SkyLight::for_batches(Job job, std::span<const uint32_t> numbers, const std::function<void(const Job&)>& f) {
  const auto key = [&](uint32_t i) {
    const Vec3& c = places_[i].centre;
    return std::tuple(points_.instance[i], grazing_of_[i], c.x, c.y, c.z);
  };
  runs_.clear();
  for (uint32_t i = 0; i < numbers.size(); ++i) {
    if (i == 0 || key(numbers[i]) != key(numbers[i - 1])) runs_.push_back({i, i});
    runs_.back().end = i + 1;
  }
  const auto is_before = [&](const Run& a, const Run& b) { return key(numbers[a.begin]) < key(numbers[b.begin]); };
  std::stable_sort(runs_.begin(), runs_.end(), is_before);
  order_.clear();
  for (const Run& run : runs_)
    order_.insert(order_.end(), &numbers[run.begin], &numbers[run.begin] + (run.end - run.begin));
  for (size_t begin = 0, end = 0; begin < order_.size(); begin = end) {
    const uint32_t first = order_[begin], instance = points_.instance[first];
    job.place = places_[first];
    grazing_ = grazing_of_[first];
    batch_.clear();
    for (end = begin; end < order_.size() && end - begin < k_sky_batch; ++end) {
      const uint32_t next = order_[end];
      if (points_.instance[next] != instance || grazing_of_[next] != grazing_) break;
      if (places_[next].centre != job.place.centre) break;
      batch_.push_back(clusters_[next]);
    }
    job.clusters = batch_;
    job.numbers = std::span(order_).subspan(begin, end - begin);
    centres_.resize(batch_.size());
    for (size_t i = 0; i < batch_.size(); ++i) centres_.copy(i, points_, order_[begin + i]);
    // Lanes of the padding see what the first point sees.
    for (size_t i = batch_.size(); i < padded(batch_.size()); ++i) centres_.copy(i, centres_, 0);
    f(job);
  }
}

SkyLight::Job SkyLight::job_of(const Request& r) const { return {r.receivers, r.light_samples, r.firsts, r.stats}; }

void SkyLight::begin(const Request& r) {
  choose_points(r.clusters, r.receivers, r.vertices);
  find_blocks(r.receivers, r.pixels);
  const Vec3 up(0.0f, 0.0f, 1.0f);
  unit_ = luminance(sky_->radiance().irradiance(up) + sky_->radiance().irradiance(-up)) + 1e-30f;
  if (sky_->indirect()) unit_ = std::max(unit_, k_pi * sky_->indirect()->mean_luminance());
}

void SkyLight::refine(const Request& r) {
  wanted_.clear();
  if (r.pixels.empty()) return;
  blocks_.refine(k_fit_tolerance * context_.settings.tolerance, arrivals_, fitted_, wanted_);
}

void SkyLight::finish(const Request& r) {
  const Job job = job_of(r);
  add_irradiance(job);
  if (context_.answerer.checks()) check_fitted(job);
  if (!sky_->radiance().concentrated() || clusters_.empty()) return;
  concentrated_.begin(points_);
  wanted_.resize(clusters_.size());
  std::iota(wanted_.begin(), wanted_.end(), 0u);
  for_batches(job, wanted_, [&](const Job& batch) {
    concentrated_.gather(batch.clusters, centres_, r.vertices, batch.light_samples, batch.receivers, batch.firsts,
                         batch.stats);
  });
}

void SkyLight::gather(const Request& r) {
  const ScopedTimer timer(r.stats.time_secondary);
  SkyLight& s = r.sky;
  for (s.begin(r); !s.wanted_.empty(); s.refine(r)) {
    s.for_batches(s.job_of(r), s.wanted_, [&](const Job& batch) {
      s.see_batch(batch);
      s.keep_arrivals(batch);
      if (s.context_.answerer.checks()) s.check_cells(batch);
    });
  }
  s.finish(r);
}

}  // namespace fieldtrace
