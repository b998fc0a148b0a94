#include "hybrid/light/direct_light.h"

#include <algorithm>
#include <cmath>

#include "core/sampling/sobol.hd.h"
#include "hybrid/stats/stopwatch.h"

namespace fieldtrace {
namespace {

constexpr float k_undecided = -1.0f;  // StrataSeen::share

void select_points(const ShadingPointBatch& all, std::span<const uint32_t> indices, ShadingPointBatch& chosen) {
  chosen.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) chosen.copy(i, all, indices[i], 1);
}

void add_products(size_t count, float a, const float* b, const float* c, float* __restrict sum) {
  for (size_t i = 0; i < count; ++i) sum[i] += a * b[i] * c[i];
}

// Adds value x reflected x factors[i] to what arrives at receivers [begin, begin + count).
void add_light(LightReceivers& r, size_t begin, size_t count, const Rgb& value, const float* factors) {
  add_products(count, value.x, &r.red[begin], factors, &r.arriving_red[begin]);
  add_products(count, value.y, &r.green[begin], factors, &r.arriving_green[begin]);
  add_products(count, value.z, &r.blue[begin], factors, &r.arriving_blue[begin]);
}

Rgb value_of(const Light& light) { return {light.value[0], light.value[1], light.value[2]}; }

}  // namespace

bool DirectLight::on_grid(const Job& job) const {
  // Points of mesh lights take a third random number.
  const LightKind kind = context_.lights.lights[job.light].kind;
  return context_.light_extents[job.light].kind == LightExtent::Kind::bounded && kind != LightKind::mesh &&
         kind != LightKind::point;
}

bool DirectLight::is_above(const Job& job, const Vec3& p, const Vec3& normal, float margin) const {
  const Sphere& ball = context_.light_extents[job.light].ball;
  return glm::dot(normal, ball.centre - p) > ball.radius + margin;
}

bool DirectLight::is_above(const Job& job, uint32_t cluster) const {
  const Vec3 p(centres_.px[cluster], centres_.py[cluster], centres_.pz[cluster]);
  const Vec3 g(centres_.gx[cluster], centres_.gy[cluster], centres_.gz[cluster]);
  const Vec3 s(centres_.sx[cluster], centres_.sy[cluster], centres_.sz[cluster]);
  const float distance = glm::length(context_.light_extents[job.light].ball.centre - p);
  const float radius = centres_.radius[cluster];
  const float margin = radius + (distance + radius) * cluster_of(job, cluster).spread;
  return is_above(job, p, g, margin) && is_above(job, p, s, margin);
}

void DirectLight::count_seen(const Job& job, size_t point, float decided, float clear) const {
  if (job.firsts.empty()) return;
  FirstHit& first = first_of(job, point);
  first.shadow_rays += decided * float(job.light_samples);
  first.shadow_clear += clear * float(job.light_samples);
}

void DirectLight::add_irradiance(const Job& job, uint32_t cluster, const Vec3& irradiance, float decided, float clear) {
  const ShadingCluster& c = cluster_of(job, cluster);
  LightReceivers& r = job.receivers;
  const float *sx = &r.points.sx[c.begin], *sy = &r.points.sy[c.begin], *sz = &r.points.sz[c.begin];
  factors_.resize(padded(c.size()));
  float* const received = factors_.data();
  for (size_t i = 0; i < c.size(); ++i) {
    const float cosine = sx[i] * irradiance.x + sy[i] * irradiance.y + sz[i] * irradiance.z;
    received[i] = cosine > 0.0f ? cosine : 0.0f;
  }
  add_light(r, c.begin, c.size(), value_of(context_.lights.lights[job.light]), received);
  if (job.firsts.empty()) return;
  for (size_t i = c.begin; i < c.end; ++i) count_seen(job, i, decided, clear);
}

void DirectLight::select(const Job& job, std::span<const Sampled> batch) {
  size_t count = 0;
  for (const Sampled& s : batch) count += s.size();
  selected_.resize(count);
  count = 0;
  for (size_t i = 0, next = 0; i < batch.size(); i = next) {
    for (next = i + 1; next < batch.size() && batch[next].begin == batch[next - 1].end;) ++next;
    const size_t run = batch[next - 1].end - batch[i].begin;
    selected_.copy(count, job.receivers.points, batch[i].begin, run);
    count += run;
  }
}

void DirectLight::push_sampled(const Job& job, uint32_t cluster, uint32_t strata, bool is_lit) {
  const ShadingCluster& c = cluster_of(job, cluster);
  sampled_.push_back({c.begin, c.end, cluster, strata, is_lit});
}

void DirectLight::add_cluster_irradiance(const Job& job) {
  select_points(centres_, clear_, selected_);
  irradiance_vectors(context_.lights.lights[job.light], selected_, context_.settings.isa, vectors_);
  for (size_t r = 0; r < clear_.size(); ++r) {
    const uint32_t cluster = clear_[r];
    if (vectors_.known[r] && cluster_of(job, cluster).plain_diffuse() && is_above(job, cluster)) {
      add_irradiance(job, cluster, Vec3(vectors_.x[r], vectors_.y[r], vectors_.z[r]), 1.0f, 1.0f);
    } else {
      push_sampled(job, cluster);
    }
  }
}

void DirectLight::add_point_irradiance(const Job& job) {
  std::vector<Sampled> others;
  for (const uint32_t cluster : clear_) {
    if (cluster_of(job, cluster).plain_diffuse()) push_sampled(job, cluster);
  }
  select(job, sampled_);
  whole_irradiance(context_.lights.lights[job.light], selected_, context_.settings.isa, irradiance_);
  const Rgb value = value_of(context_.lights.lights[job.light]);
  const auto is_known = [&](size_t i) { return irradiance_[i] >= 0.0f; };
  size_t i = 0;
  for (const Sampled& s : sampled_) {
    for (uint32_t begin = s.begin, end = begin; begin < s.end; begin = end) {
      const bool known = is_known(i);
      const size_t first = i++;
      for (end = begin + 1; end < s.end && is_known(i) == known; ++end) ++i;
      if (known) {
        add_light(job.receivers, begin, end - begin, value, &irradiance_[first]);
        for (uint32_t point = begin; point < end; ++point) count_seen(job, point, 1.0f, 1.0f);
      } else {
        others.push_back({begin, end, s.cluster});
      }
    }
  }
  sampled_.swap(others);
  for (const uint32_t cluster : clear_) {
    if (!cluster_of(job, cluster).plain_diffuse()) push_sampled(job, cluster);
  }
}

void DirectLight::light_clear(const Job& job) {
  sampled_.clear();
  if (!context_.closed_form[job.light]) {
    for (const uint32_t cluster : clear_) push_sampled(job, cluster);
  } else if (context_.settings.estimates) {
    add_cluster_irradiance(job);
  } else {
    add_point_irradiance(job);
  }
  sample(job, false);
}

DirectLight::StrataSeen DirectLight::strata_seen(const Job& job, uint32_t cluster, size_t first_slot) const {
  StrataSeen seen;
  seen.whole = context_.closed_form[job.light] && cluster_of(job, cluster).plain_diffuse() && is_above(job, cluster);
  constexpr float k_part = 1.0f / float(k_strata);
  for (int k = 0; k < k_strata; ++k) {
    const size_t slot = first_slot + size_t(k);
    // Of a stratum whose centre lies below the horizon, a part may lie above.
    const bool is_active = shadows_.rays.tmax[slot] >= 0.0f;
    seen.whole = seen.whole && is_active;
    seen.share[k] = undecided_[slot] || !is_active ? k_undecided : shadows_.clear[slot];
    if (seen.share[k] < 0.0f) continue;
    seen.decided += k_part;
    seen.clear += k_part * seen.share[k];
    seen.irradiance += glm::normalize(shadows_.rays.direction(slot)) * (k_part * seen.share[k] / shadows_.pdf[slot]);
  }
  return seen;
}

void DirectLight::filter_batch(const Job& job, std::span<const uint32_t> clusters) {
  select_points(centres_, clusters, selected_);
  sample_light(context_.lights, job.light, selected_, {k_strata, 0, k_strata, k_strata_side}, context_.settings.isa,
               shadows_);
  job.stats.strata += shadows_.active;
  context_.answerer.filter(candidates_, centres_, clusters, k_strata, shadows_, undecided_, job.stats);
  for (size_t r = 0; r < clusters.size(); ++r) {
    const uint32_t cluster = clusters[r];
    const StrataSeen seen = strata_seen(job, cluster, r * size_t(k_strata));
    int undecided = 0;
    for (size_t slot = r * k_strata; slot < (r + 1) * k_strata; ++slot) {
      undecided += undecided_[slot] && shadows_.rays.tmax[slot] >= 0.0f;
    }
    job.stats.strata_refused += uint64_t(undecided);
    if (undecided > context_.settings.most_undecided) {
      open_.push_back(cluster);
      continue;
    }
    if (context_.answerer.checks()) check_strata(job, cluster, seen);
    const uint32_t samples = candidates_.light_samples[cluster];
    context_.answerer.count_filtered(candidates_, cluster, uint32_t(float(samples) * seen.decided), job.stats);
    const bool all = seen.decided == 1.0f;
    if (all && seen.clear == 1.0f) {
      clear_.push_back(cluster);
    } else if (all && seen.clear == 0.0f) {
      dark_.push_back(cluster);
    } else {
      seen_of_[cluster] = uint32_t(seen_.size());
      seen_.push_back(seen);
      open_.push_back(cluster);
      continue;
    }
    job.stats.samples_spared += samples;
    job.stats.samples_by_strata += samples;
  }
}

void DirectLight::filter_strata(const Job& job) {
  seen_.clear();
  seen_of_.assign(centres_.size, k_none);
  if (!context_.answerer.filters(candidates_) || !on_grid(job)) return;
  std::vector<uint32_t> filtered, others;
  for (const uint32_t c : open_) {
    const bool filters = !candidates_.by_rays[c] && candidates_.light_samples[c] >= k_fewest_cone_samples;
    (filters ? filtered : others).push_back(c);
  }
  open_.swap(others);
  constexpr size_t k_clusters = k_shadow_batch / k_strata;
  for (size_t begin = 0; begin < filtered.size(); begin += k_clusters) {
    filter_batch(job, std::span(filtered).subspan(begin, std::min(k_clusters, filtered.size() - begin)));
  }
  std::sort(open_.begin(), open_.end());
}

void DirectLight::light_open(const Job& job) {
  sampled_.clear();
  for (const uint32_t cluster : open_) {
    const uint32_t index = seen_of_[cluster];
    const StrataSeen* seen = index == k_none ? nullptr : &seen_[index];
    const bool is_lit = seen && seen->whole;
    if (is_lit) add_irradiance(job, cluster, seen->irradiance, seen->decided, seen->clear);
    if (is_lit && seen->decided == 1.0f) {
      job.stats.samples_spared += candidates_.light_samples[cluster];
      job.stats.samples_by_strata += candidates_.light_samples[cluster];
    } else {
      push_sampled(job, cluster, index, is_lit);
    }
  }
  sample(job, true);
}

std::span<const DirectLight::Sampled> DirectLight::batch_from(size_t begin, int light_samples) const {
  const size_t most = size_t(std::max(k_shadow_batch / light_samples, 1));
  size_t end = begin;
  for (size_t points = 0; end < sampled_.size() && points < most; ++end) points += sampled_[end].size();
  return std::span(sampled_).subspan(begin, end - begin);
}

void DirectLight::sample(const Job& job, bool may_be_hidden) {
  const int samples = may_be_hidden && job.counts_open ? job.open_samples : job.light_samples;
  std::span<const Sampled> batch;
  for (size_t begin = 0; begin < sampled_.size(); begin += batch.size()) {
    batch = batch_from(begin, samples);
    {
      const ScopedTimer timer(job.stats.time_secondary);
      select(job, batch);
      LightSampleRange range = {samples, 0, samples};
      if (may_be_hidden && on_grid(job)) range.cell_columns = range.cell_rows = k_strata_side;
      sample_light(context_.lights, job.light, selected_, range, context_.settings.isa, shadows_);
      job.stats.samples += selected_.size * uint64_t(samples - job.light_samples);
      const uint64_t traced = job.stats.rays_exact;
      if (may_be_hidden) answer(job, batch, samples);
      if (job.counts_open) job.stats.rays_open += job.stats.rays_exact - traced;
    }
    job.stats.rays_shadow += shadows_.active;
    add_samples(job, batch, samples);
  }
}

void DirectLight::answer(const Job& job, std::span<const Sampled> batch, int samples) {
  if (std::all_of(batch.begin(), batch.end(), [](const Sampled& s) { return s.strata == k_none; })) {
    context_.answerer.answer(candidates_, shadows_, job.stats);
    return;
  }
  const size_t m = size_t(samples);
  shadows_.in_shares = true;
  shadows_.clear.assign(padded(shadows_.rays.size), 0.0f);
  traced_slots_.clear();
  size_t slot = 0;
  for (const Sampled& s : batch) {
    for (const size_t end = slot + s.size() * m; slot < end; ++slot) {
      if (shadows_.rays.tmax[slot] < 0.0f) continue;
      const float share = s.strata == k_none ? k_undecided : seen_[s.strata].share[shadows_.cell[slot]];
      if (share >= 0.0f) {
        shadows_.clear[slot] = s.is_lit ? 0.0f : share;
        ++job.stats.samples_by_strata;
        ++job.stats.samples_spared;
      } else {
        traced_slots_.push_back(uint32_t(slot));
      }
    }
  }
  traced_.resize(traced_slots_.size());
  for (size_t j = 0; j < traced_slots_.size(); ++j) {
    traced_.rays.copy(j, shadows_.rays, traced_slots_[j]);
    traced_.instance[j] = shadows_.instance[traced_slots_[j]];
  }
  context_.answerer.answer(candidates_, traced_, job.stats);
  for (size_t j = 0; j < traced_slots_.size(); ++j) {
    shadows_.clear[traced_slots_[j]] = traced_.blocked[j] ? 0.0f : 1.0f;
    shadows_.exact[traced_slots_[j]] = traced_.exact[j];
  }
}

void DirectLight::add_samples(const Job& job, std::span<const Sampled> batch, int samples) {
  const Light& light = context_.lights.lights[job.light];
  const LightEstimate estimate = {value_of(light), job.light_samples, context_.closed_form[job.light] != 0,
                                  light.kind == LightKind::environment, job.sky_is_mapped};
  const size_t m = size_t(samples);
  const float share = float(job.light_samples) / float(samples);  // so that all shading points count alike
  size_t slot = 0;
  for (const Sampled& s : batch) {
    add_range(job, s, slot, samples, estimate);
    if (job.firsts.empty()) {
      slot += s.size() * m;
      continue;
    }
    for (uint32_t point = s.begin; point < s.end; ++point) {
      FirstHit& first = first_of(job, point);
      for (const size_t end = slot + m; slot < end; ++slot) {
        if (shadows_.rays.tmax[slot] < 0.0f) continue;
        if (s.is_lit && seen_[s.strata].share[shadows_.cell[slot]] >= 0.0f) continue;  // counted by its share
        first.shadow_rays += share;
        first.shadow_clear += share * (shadows_.in_shares ? shadows_.clear[slot] : float(!shadows_.blocked[slot]));
        first.shadow_exact += share * float(shadows_.exact[slot]);
      }
    }
  }
}

void DirectLight::add_range(const Job& job, const Sampled& s, size_t first_slot, int samples,
                            const LightEstimate& estimate) {
  LightReceivers& r = job.receivers;
  const size_t m = size_t(samples);
  if (m == 1 && estimate.closed_form && !estimate.varies && cluster_of(job, s.cluster).plain_diffuse()) {
    factors_.resize(padded(s.size()));
    float* const seen = factors_.data();
    const float *weight = &shadows_.weight[first_slot], *clear = shadows_.clear.data() + first_slot;
    const uint8_t* const blocked = &shadows_.blocked[first_slot];
    if (shadows_.in_shares) {
      for (size_t i = 0; i < s.size(); ++i) seen[i] = weight[i] * clear[i];
    } else {
      for (size_t i = 0; i < s.size(); ++i) seen[i] = weight[i] * float(!blocked[i]);
    }
    add_light(r, s.begin, s.size(), estimate.value, seen);
    return;
  }
  for (size_t i = s.begin, slot = first_slot; i < s.end; ++i, slot += m) {
    const Rgb light = r.vertex[i] == k_none
                          ? reflected_light(shadows_, slot, samples, estimate, Rgb(r.red[i], r.green[i], r.blue[i]))
                          : reflected_light(shadows_, slot, samples, estimate, job.vertices[r.vertex[i]]);
    r.arriving_red[i] += light.x, r.arriving_green[i] += light.y, r.arriving_blue[i] += light.z;
  }
}

// For the layers: only sampling tells which samples of vertices that see nothing would have become rays.
void DirectLight::count_dark(const Job& job) {
  sampled_.clear();
  for (const uint32_t cluster : dark_) push_sampled(job, cluster);
  const size_t m = size_t(job.light_samples);
  std::span<const Sampled> batch;
  for (size_t begin = 0; begin < sampled_.size(); begin += batch.size()) {
    batch = batch_from(begin, job.light_samples);
    select(job, batch);
    sample_light(context_.lights, job.light, selected_, job.light_samples, context_.settings.isa, shadows_);
    size_t slot = 0;
    for (const Sampled& s : batch) {
      for (uint32_t point = s.begin; point < s.end; ++point) {
        for (const size_t last = slot + m; slot < last; ++slot) {
          first_of(job, point).shadow_rays += float(shadows_.rays.tmax[slot] >= 0.0f);
        }
      }
    }
  }
}

void DirectLight::check_whole(const Job& job) {
  for (const bool blocked : {false, true}) {
    sampled_.clear();
    std::vector<uint32_t> clusters;
    for (const uint32_t cluster : blocked ? dark_ : clear_) push_sampled(job, cluster);
    if (sampled_.empty()) continue;
    for (const Sampled& s : sampled_) clusters.insert(clusters.end(), s.size(), s.cluster);
    select(job, sampled_);
    sample_light(context_.lights, job.light, selected_, job.light_samples, context_.settings.isa, shadows_);
    context_.answerer.check_whole(candidates_, blocked, clusters, job.light_samples, shadows_, job.stats);
  }
}

// 64 rays to each stratum, from the cluster's points in turn.
void DirectLight::check_strata(const Job& job, uint32_t cluster, const StrataSeen& seen) const {
  constexpr int k_side = 8, k_columns = k_strata_side * k_side, k_rays = k_side * k_side;
  const ShadingCluster& c = cluster_of(job, cluster);
  const ShadingPointBatch& points = job.receivers.points;
  // One cluster in so many, whatever the groups.
  constexpr uint32_t k_interval = 16;
  if (scalar::hash_uint(points.seed[c.begin]) % k_interval != 0) return;
  ShadingPointBatch centre;
  const uint32_t only[] = {cluster};
  select_points(centres_, only, centre);
  ShadowBatch by_rows, rays;
  constexpr int k_all = k_strata * k_rays;
  sample_light(context_.lights, job.light, centre, {k_all, 0, k_all, k_columns}, context_.settings.isa, by_rows);
  rays.resize(size_t(k_all));
  const Vec3 middle(centre.px[0], centre.py[0], centre.pz[0]);
  for (int i = 0; i < k_all; ++i) {
    const int row = i / k_columns, column = i % k_columns;
    const int stratum = row / k_side * k_strata_side + column / k_side;
    const int ray = row % k_side * k_side + column % k_side;
    const uint32_t from = c.begin + uint32_t(ray) % c.size();
    const Vec3 aside = Vec3(points.px[from], points.py[from], points.pz[from]) - middle;
    rays.rays.set(size_t(stratum * k_rays + ray), by_rows.rays.origin(size_t(i)) + aside,
                  by_rows.rays.direction(size_t(i)) - aside, by_rows.rays.tmax[size_t(i)]);
  }
  context_.answerer.check_shares(candidates_, k_rays, rays, seen.share, job.stats);
}

void DirectLight::gather_light(const Job& job) {
  Stats& stats = job.stats;
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    for (auto* list : {&dark_, &clear_, &open_}) list->clear();
    candidates_.light = context_.light_extents[job.light];
    context_.answerer.find_candidates(centres_, candidates_, stats);
    for (uint32_t c = 0; c < centres_.size; ++c) {
      if (job.sky_is_mapped && cluster_of(job, c).takes_maps_alone()) continue;
      // A light that cannot block its own samples is flat or convex, and does not light itself; by rounding its points
      // may lie on its bright side.
      if (centres_.instance[c] == candidates_.light.instance) continue;
      const int32_t shadow = candidates_.shadow[c];
      const bool is_settled = !shadow || shadow & k_light_blocked;
      if (is_settled && candidates_.met[c]) stats.samples_spared += candidates_.light_samples[c];
      (shadow & k_light_blocked ? dark_ : shadow ? open_ : clear_).push_back(c);
    }
  }
  if (context_.answerer.checks()) check_whole(job);
  {
    const ScopedTimer timer(stats.time_secondary);
    filter_strata(job);
  }
  light_open(job);
  stats.time_secondary -= stats.time_bake - bake_before;
  light_clear(job);
  if (!job.firsts.empty()) count_dark(job);
}

void DirectLight::gather_group(Job& job) {
  clusters_.centres(job.begin, job.end, centres_);
  candidates_.light_samples.resize(centres_.size);
  uint64_t samples = 0;
  for (uint32_t c = 0; c < centres_.size; ++c) {
    candidates_.light_samples[c] = clusters_[job.begin + c].size() * uint32_t(job.light_samples);
    samples += candidates_.light_samples[c];
  }
  for (job.light = 0; job.light < context_.lights.size(); ++job.light) {
    const LightKind kind = context_.lights.lights[job.light].kind;
    if (kind == LightKind::none) continue;
    const bool is_of_sky = is_sky(context_.scene.emitters[job.light].kind);
    // All samples of a point or a direction are the same.
    const bool is_delta = kind == LightKind::point || kind == LightKind::directional;
    job.counts_open = job.first && !is_delta && !(is_of_sky && context_.settings.sky_by_maps);
    job.sky_is_mapped = job.has_sky_maps && is_of_sky;
    if (job.sky_is_mapped) {  // SkyLight has lit the diffuse ones and the bodies of plastics
      const auto is_left = [&](size_t c) { return !clusters_[job.begin + c].takes_maps_alone(); };
      uint64_t left = 0;
      for (size_t c = 0; c < centres_.size; ++c) left += is_left(c) ? candidates_.light_samples[c] : 0;
      if (left == 0) continue;
      job.stats.samples += left;
    } else {
      job.stats.samples += samples;
    }
    gather_light(job);
  }
}

void DirectLight::gather(LightReceivers& receivers, std::span<const PathVertex> vertices, int light_samples, bool first,
                         std::span<const PixelPosition> pixels, std::span<FirstHit> firsts, Stats& stats) {
  const int pixel_samples = first ? context_.settings.pixel_samples : 1;
  candidates_.pixel_samples = int64_t(pixel_samples) * light_samples;
  const auto most = uint32_t(std::max(2 * k_shadow_batch / light_samples, 1));
  clusters_.build(receivers, context_.light_extents, most,
                  pixel_samples == 1 || (candidates_.few_samples() && !(first && context_.sky)));
  for (auto* sum : {&receivers.arriving_red, &receivers.arriving_green, &receivers.arriving_blue}) {
    sum->assign(receivers.size(), 0.0f);
  }
  Job job{receivers, vertices, light_samples, light_samples, first, false, firsts, stats};
  if (first) job.open_samples = std::max(light_samples, context_.settings.open_light_samples);
  job.has_sky_maps = first && context_.sky;
  if (job.has_sky_maps) sky_.gather(clusters_, receivers, vertices, light_samples, pixels, firsts, stats);
  for (job.begin = 0; job.begin < clusters_.size(); job.begin = job.end) {
    size_t samples = 0;
    for (job.end = job.begin; job.end < clusters_.size(); ++job.end) {
      samples += size_t(clusters_[job.end].size()) * size_t(light_samples);
      if (samples > size_t(k_shadow_batch) && job.end > job.begin) break;
    }
    gather_group(job);
  }
}

}  // namespace fieldtrace
