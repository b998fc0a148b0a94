#include "hybrid/light/group_light.h"

#include <algorithm>
#include <cmath>

#include "core/platform/stopwatch.h"

namespace fieldtrace {
namespace {

constexpr float k_undecided = -1.0f;  // StrataSeen::share

void add_products(size_t count, float a, const float* b, const float* c, float* __restrict sum) {
  for (size_t i = 0; i < count; ++i) sum[i] += a * b[i] * c[i];
}

// Adds value x reflected x factors[i] to what arrives at receivers [begin, begin + count).
void add_light(LightReceivers& r, size_t begin, size_t count, const Rgb& value, const float* factors) {
  add_products(count, value.x, &r.red[begin], factors, &r.arriving_red[begin]);
  add_products(count, value.y, &r.green[begin], factors, &r.arriving_green[begin]);
  add_products(count, value.z, &r.blue[begin], factors, &r.arriving_blue[begin]);
}

}  // namespace

Rgb GroupLight::light_value() const {
  const float* const value = context_.lights.lights[light_].value;
  return {value[0], value[1], value[2]};
}

bool GroupLight::is_above(const Vec3& p, const Vec3& normal, float margin) const {
  const Sphere& ball = context_.light_extents[light_].ball;
  return glm::dot(normal, ball.centre - p) > ball.radius + margin;
}

bool GroupLight::is_above(uint32_t cluster) const {
  const Vec3 p = centres_.position(cluster);
  const float distance = glm::length(context_.light_extents[light_].ball.centre - p);
  const float radius = centres_.radius[cluster];
  const float margin = radius + (distance + radius) * cluster_of(cluster).spread;
  return is_above(p, centres_.geometric_normal(cluster), margin) &&
         is_above(p, centres_.shading_normal(cluster), margin);
}

void GroupLight::count_seen(size_t point, float decided, float clear) const {
  if (shared_->firsts.empty()) return;
  FirstHit& first = first_of(point);
  first.shadow_rays += decided * float(shared_->light_samples);
  first.shadow_clear += clear * float(shared_->light_samples);
}

void GroupLight::add_irradiance(uint32_t cluster, const Vec3& irradiance, const StrataSeen* seen) {
  if (context_.answerer.checks()) check_irradiance(cluster, irradiance, seen);
  const ShadingCluster& c = cluster_of(cluster);
  LightReceivers& r = shared_->receivers;
  const float *sx = &r.points.sx[c.begin], *sy = &r.points.sy[c.begin], *sz = &r.points.sz[c.begin];
  factors_.resize(padded(c.size()));
  float* const received = factors_.data();
  for (size_t i = 0; i < c.size(); ++i) {
    const float cosine = sx[i] * irradiance.x + sy[i] * irradiance.y + sz[i] * irradiance.z;
    received[i] = cosine > 0.0f ? cosine : 0.0f;
  }
  add_light(r, c.begin, c.size(), light_value(), received);
  if (shared_->firsts.empty()) return;
  const float decided = seen ? seen->decided : 1.0f, clear = seen ? seen->clear : 1.0f;
  for (size_t i = c.begin; i < c.end; ++i) count_seen(i, decided, clear);
}

void GroupLight::select(std::span<const Sampled> batch, ShadingPointBatch& selected) const {
  size_t count = 0;
  for (const Sampled& s : batch) count += s.size();
  selected.resize(count);
  count = 0;
  for (size_t i = 0, next = 0; i < batch.size(); i = next) {
    for (next = i + 1; next < batch.size() && batch[next].begin == batch[next - 1].end;) ++next;
    const size_t run = batch[next - 1].end - batch[i].begin;
    selected.copy(count, shared_->receivers.points, batch[i].begin, run);
    count += run;
  }
}

void GroupLight::push_sampled(uint32_t cluster, uint32_t strata, bool is_lit) {
  const ShadingCluster& c = cluster_of(cluster);
  sampled_.push_back({c.begin, c.end, cluster, strata, is_lit});
}

GroupLight::Batch& GroupLight::next_batch() {
  if (laid_out_ == batches_.size()) batches_.emplace_back();
  return batches_[laid_out_++];
}

void GroupLight::add_cluster_irradiance() {
  ShadingPointBatch& centres = next_batch().selected;
  laid_out_ = 0;
  copy_points(centres_, clear_, centres);
  irradiance_vectors(context_.lights.lights[light_], centres, context_.settings.isa, vectors_);
  for (size_t r = 0; r < clear_.size(); ++r) {
    const uint32_t cluster = clear_[r];
    if (vectors_.known[r] && cluster_of(cluster).plain_diffuse() && is_above(cluster)) {
      add_irradiance(cluster, Vec3(vectors_.x[r], vectors_.y[r], vectors_.z[r]), nullptr);
    } else {
      push_sampled(cluster);
    }
  }
}

void GroupLight::add_point_irradiance() {
  std::vector<Sampled> others;
  for (const uint32_t cluster : clear_) {
    if (cluster_of(cluster).plain_diffuse()) push_sampled(cluster);
  }
  ShadingPointBatch& points = next_batch().selected;
  laid_out_ = 0;
  select(sampled_, points);
  whole_irradiance(context_.lights.lights[light_], points, context_.settings.isa, irradiance_);
  const Rgb value = light_value();
  const auto is_known = [&](size_t i) { return irradiance_[i] >= 0.0f; };
  size_t i = 0;
  for (const Sampled& s : sampled_) {
    for (uint32_t begin = s.begin, end = begin; begin < s.end; begin = end) {
      const bool known = is_known(i);
      const size_t first = i++;
      for (end = begin + 1; end < s.end && is_known(i) == known; ++end) ++i;
      if (known) {
        add_light(shared_->receivers, begin, end - begin, value, &irradiance_[first]);
        for (uint32_t point = begin; point < end; ++point) count_seen(point, 1.0f, 1.0f);
      } else {
        others.push_back({begin, end, s.cluster});
      }
    }
  }
  sampled_.swap(others);
  for (const uint32_t cluster : clear_) {
    if (!cluster_of(cluster).plain_diffuse()) push_sampled(cluster);
  }
}

void GroupLight::light_clear() {
  sampled_.clear();
  if (!context_.closed_form[light_]) {
    for (const uint32_t cluster : clear_) push_sampled(cluster);
  } else if (context_.settings.estimates) {
    add_cluster_irradiance();
  } else {
    add_point_irradiance();
  }
  sample_clear();
}

GroupLight::StrataSeen GroupLight::strata_seen(const Batch& batch, uint32_t cluster, size_t first_slot) const {
  const ShadowBatch& shadows = batch.shadows;
  StrataSeen seen;
  seen.whole = context_.closed_form[light_] && cluster_of(cluster).plain_diffuse() && is_above(cluster);
  constexpr float k_part = 1.0f / float(k_strata);
  for (int k = 0; k < k_strata; ++k) {
    const size_t slot = first_slot + size_t(k);
    // Of a stratum whose centre lies below the horizon, a part may lie above.
    const bool is_active = shadows.rays.tmax[slot] >= 0.0f;
    seen.whole = seen.whole && is_active;
    seen.share[k] = batch.undecided[slot] || !is_active ? k_undecided : shadows.clear[slot];
    if (seen.share[k] < 0.0f) continue;
    seen.decided += k_part;
    seen.clear += k_part * seen.share[k];
    seen.irradiance += glm::normalize(shadows.rays.direction(slot)) * (k_part * seen.share[k] / shadows.pdf[slot]);
  }
  return seen;
}

void GroupLight::list_strata() {
  seen_.clear();
  seen_of_.assign(centres_.size, k_none);
  filtered_.clear();
  next_filtered_ = 0;
  if (!context_.answerer.filters(candidates_) || grid_.columns == 0) return;
  std::vector<uint32_t> others;
  for (const uint32_t c : open_) {
    const bool filters = !candidates_.by_rays[c] && candidates_.light_samples[c] >= k_fewest_cone_samples;
    (filters ? filtered_ : others).push_back(c);
  }
  open_.swap(others);
}

ShadowAnswerer::FilterRequest GroupLight::ask_strata() {
  constexpr size_t k_clusters = k_shadow_batch / k_strata;
  Batch& batch = next_batch();
  batch.clusters =
      std::span(filtered_).subspan(next_filtered_, std::min(k_clusters, filtered_.size() - next_filtered_));
  next_filtered_ += batch.clusters.size();
  copy_points(centres_, batch.clusters, batch.selected);
  sample_light(context_.lights, light_, batch.selected, {k_strata, 0, k_strata, grid_.columns}, context_.settings.isa,
               batch.shadows);
  shared_->stats.strata += batch.shadows.active;
  return {candidates_, centres_, batch.clusters, k_strata, batch.shadows, batch.undecided, shared_->stats};
}

void GroupLight::take_strata() {
  for (size_t i = 0; i < laid_out_; ++i) take_strata(batches_[i]);
  laid_out_ = 0;
  if (!has_strata()) std::sort(open_.begin(), open_.end());
}

void GroupLight::take_strata(const Batch& batch) {
  Stats& stats = shared_->stats;
  const int most_undecided = int(k_most_undecided_strata * context_.settings.tolerance / k_default_tolerance);
  for (size_t r = 0; r < batch.clusters.size(); ++r) {
    const uint32_t cluster = batch.clusters[r];
    const StrataSeen seen = strata_seen(batch, cluster, r * size_t(k_strata));
    int undecided = 0;
    for (size_t slot = r * k_strata; slot < (r + 1) * k_strata; ++slot) {
      undecided += batch.undecided[slot] && batch.shadows.rays.tmax[slot] >= 0.0f;
    }
    stats.strata_refused += uint64_t(undecided);
    if (undecided > most_undecided) {
      open_.push_back(cluster);
      continue;
    }
    if (context_.answerer.checks()) check_strata(cluster, seen);
    const bool all = seen.decided == 1.0f;
    if (all && seen.clear == 1.0f) {
      clear_.push_back(cluster);
    } else if (all && seen.clear == 0.0f) {
      if (context_.answerer.checks() && seen.whole) check_irradiance(cluster, Vec3(0.0f), &seen);
      dark_.push_back(cluster);
    } else {
      seen_of_[cluster] = uint32_t(seen_.size());
      seen_.push_back(seen);
      open_.push_back(cluster);
      continue;
    }
    stats.samples_spared += candidates_.light_samples[cluster];
    stats.samples_by_strata += candidates_.light_samples[cluster];
  }
}

void GroupLight::list_open() {
  sampled_.clear();
  next_sampled_ = 0;
  for (const uint32_t cluster : open_) {
    const uint32_t index = seen_of_[cluster];
    const StrataSeen* seen = index == k_none ? nullptr : &seen_[index];
    const bool is_lit = seen && seen->whole;
    if (is_lit) add_irradiance(cluster, seen->irradiance, seen);
    if (is_lit && seen->decided == 1.0f) {
      shared_->stats.samples_spared += candidates_.light_samples[cluster];
      shared_->stats.samples_by_strata += candidates_.light_samples[cluster];
    } else {
      push_sampled(cluster, index, is_lit);
    }
  }
}

std::span<const GroupLight::Sampled> GroupLight::batch_from(size_t begin, int light_samples) const {
  const size_t most = size_t(std::max(k_shadow_batch / light_samples, 1));
  size_t end = begin;
  for (size_t points = 0; end < sampled_.size() && points < most; ++end) points += sampled_[end].size();
  return std::span(sampled_).subspan(begin, end - begin);
}

GroupLight::Batch& GroupLight::sample_next(bool may_be_hidden) {
  Batch& batch = next_batch();
  batch.samples = may_be_hidden && counts_open_ ? shared_->open_samples : shared_->light_samples;
  batch.sampled = batch_from(next_sampled_, batch.samples);
  next_sampled_ += batch.sampled.size();
  select(batch.sampled, batch.selected);
  LightSampleRange range = {batch.samples, 0, batch.samples};
  if (may_be_hidden) range.cell_columns = grid_.columns, range.cell_rows = grid_.rows;
  sample_light(context_.lights, light_, batch.selected, range, context_.settings.isa, batch.shadows);
  shared_->stats.samples += batch.selected.size * uint64_t(batch.samples - shared_->light_samples);
  batch.has_strata = false;
  return batch;
}

void GroupLight::sample_clear() {
  for (next_sampled_ = 0; has_samples();) {
    Batch* batch = nullptr;
    {
      const ScopedTimer timer(shared_->stats.time_secondary);
      batch = &sample_next(false);
    }
    add_samples(*batch);
    laid_out_ = 0;
  }
}

ShadowAnswerer::RayRequest GroupLight::ask_samples() {
  const ScopedTimer timer(shared_->stats.time_secondary);
  Batch& batch = sample_next(true);
  batch.has_strata =
      std::any_of(batch.sampled.begin(), batch.sampled.end(), [](const Sampled& s) { return s.strata != k_none; });
  if (batch.has_strata) choose_traced(batch);
  return {candidates_, batch.has_strata ? batch.traced : batch.shadows, shared_->stats, counts_open_};
}

// What strata have settled takes its share; the other samples are traced.
void GroupLight::choose_traced(Batch& batch) {
  ShadowBatch& shadows = batch.shadows;
  const size_t m = size_t(batch.samples);
  shadows.clear.assign(padded(shadows.rays.size), 0.0f);
  batch.traced_slots.clear();
  size_t slot = 0;
  for (const Sampled& s : batch.sampled) {
    for (const size_t end = slot + s.size() * m; slot < end; ++slot) {
      if (shadows.rays.tmax[slot] < 0.0f) continue;
      const float share = s.strata == k_none ? k_undecided : seen_[s.strata].share[shadows.cell[slot]];
      if (share >= 0.0f) {
        shadows.clear[slot] = s.is_lit ? 0.0f : share;
        ++shared_->stats.samples_by_strata;
        ++shared_->stats.samples_spared;
      } else {
        batch.traced_slots.push_back(uint32_t(slot));
      }
    }
  }
  ShadowBatch& traced = batch.traced;
  traced.resize(batch.traced_slots.size());
  for (size_t j = 0; j < batch.traced_slots.size(); ++j) {
    traced.rays.copy(j, shadows.rays, batch.traced_slots[j]);
    traced.instance[j] = shadows.instance[batch.traced_slots[j]];
  }
  traced.source = shadows.source;
  traced.source.slots = batch.traced_slots.data();
}

void GroupLight::take_samples() {
  for (size_t i = 0; i < laid_out_; ++i) {
    Batch& batch = batches_[i];
    ShadowBatch& shadows = batch.shadows;
    if (batch.has_strata) {
      for (size_t j = 0; j < batch.traced_slots.size(); ++j) {
        const uint32_t slot = batch.traced_slots[j];
        shadows.clear[slot] = batch.traced.blocked[j] ? 0.0f : 1.0f;
        shadows.exact[slot] = batch.traced.exact[j];
      }
    } else {
      for (size_t slot = 0; slot < shadows.rays.size; ++slot) shadows.clear[slot] = shadows.blocked[slot] ? 0.0f : 1.0f;
    }
    add_samples(batch);
  }
  laid_out_ = 0;
}

void GroupLight::add_samples(Batch& batch) {
  ShadowBatch& shadows = batch.shadows;
  const int samples = batch.samples;
  shared_->stats.rays_shadow += shadows.active;
  const Light& light = context_.lights.lights[light_];
  const LightEstimate estimate = {light_value(), shared_->light_samples, context_.closed_form[light_] != 0,
                                  light.kind == LightKind::environment, sky_is_mapped_};
  const size_t m = size_t(samples);
  const float share = float(shared_->light_samples) / float(samples);  // so that all shading points count alike
  size_t slot = 0;
  for (const Sampled& s : batch.sampled) {
    add_range(batch, s, slot, estimate);
    if (shared_->firsts.empty()) {
      slot += s.size() * m;
      continue;
    }
    for (uint32_t point = s.begin; point < s.end; ++point) {
      FirstHit& first = first_of(point);
      for (const size_t end = slot + m; slot < end; ++slot) {
        if (shadows.rays.tmax[slot] < 0.0f) continue;
        if (s.is_lit && seen_[s.strata].share[shadows.cell[slot]] >= 0.0f) continue;  // counted by its share
        first.shadow_rays += share;
        first.shadow_clear += share * shadows.clear[slot];
        first.shadow_exact += share * float(shadows.exact[slot]);
      }
    }
  }
}

void GroupLight::add_range(const Batch& batch, const Sampled& s, size_t first_slot, const LightEstimate& estimate) {
  const ShadowBatch& shadows = batch.shadows;
  const int samples = batch.samples;
  LightReceivers& r = shared_->receivers;
  const size_t m = size_t(samples);
  if (m == 1 && estimate.closed_form && !estimate.varies && cluster_of(s.cluster).plain_diffuse()) {
    factors_.resize(padded(s.size()));
    float* const seen = factors_.data();
    const float *weight = &shadows.weight[first_slot], *clear = &shadows.clear[first_slot];
    for (size_t i = 0; i < s.size(); ++i) seen[i] = weight[i] * clear[i];
    add_light(r, s.begin, s.size(), estimate.value, seen);
    return;
  }
  for (size_t i = s.begin, slot = first_slot; i < s.end; ++i, slot += m) {
    const Rgb light = r.vertex[i] == k_none
                          ? reflected_light(shadows, slot, samples, estimate, Rgb(r.red[i], r.green[i], r.blue[i]))
                          : reflected_light(shadows, slot, samples, estimate, shared_->vertices[r.vertex[i]]);
    r.arriving_red[i] += light.x, r.arriving_green[i] += light.y, r.arriving_blue[i] += light.z;
  }
}

// For the layers: only sampling tells which samples of vertices that see nothing would have become rays.
void GroupLight::count_dark() {
  sampled_.clear();
  for (const uint32_t cluster : dark_) push_sampled(cluster);
  const size_t m = size_t(shared_->light_samples);
  for (next_sampled_ = 0; has_samples();) {
    const Batch& batch = sample_next(false);
    laid_out_ = 0;
    size_t slot = 0;
    for (const Sampled& s : batch.sampled) {
      for (uint32_t point = s.begin; point < s.end; ++point) {
        for (const size_t last = slot + m; slot < last; ++slot) {
          first_of(point).shadow_rays += float(batch.shadows.rays.tmax[slot] >= 0.0f);
        }
      }
    }
  }
}

void GroupLight::begin(const Shared& shared, size_t begin, size_t end) {
  shared_ = &shared;
  begin_ = begin, end_ = end;
  shared.clusters.centres(begin, end, centres_);
  candidates_.pixel_samples = shared.pixel_samples;
  candidates_.light_samples.resize(centres_.size);
  samples_ = 0;
  for (uint32_t c = 0; c < centres_.size; ++c) {
    candidates_.light_samples[c] = cluster_of(c).size() * uint32_t(shared.light_samples);
    samples_ += candidates_.light_samples[c];
  }
}

bool GroupLight::begin_light(uint32_t light) {
  light_ = light;
  grid_ = strata_grid(context_.lights.lights[light]);
  const LightKind kind = context_.lights.lights[light].kind;
  if (kind == LightKind::none) return false;
  const bool is_of_sky = is_sky(context_.scene.emitters[light].kind);
  // All samples of a point or a direction are the same, and further camera samples lower a sky's noise by more.
  const bool is_delta = kind == LightKind::point || kind == LightKind::directional;
  counts_open_ = shared_->first && !is_delta && !is_of_sky;
  sky_is_mapped_ = shared_->has_sky_maps && is_of_sky;
  if (!sky_is_mapped_) {
    shared_->stats.samples += samples_;
    return true;
  }
  // SkyLight has lit the diffuse ones and the bodies of plastics.
  uint64_t left = 0;
  for (uint32_t c = 0; c < centres_.size; ++c) {
    left += cluster_of(c).takes_maps_alone() ? 0 : candidates_.light_samples[c];
  }
  shared_->stats.samples += left;
  return left > 0;
}

ShadowAnswerer::CandidateRequest GroupLight::ask_candidates() {
  candidates_.light = context_.light_extents[light_];
  return {centres_, candidates_, shared_->stats};
}

void GroupLight::take_candidates() {
  for (auto* list : {&dark_, &clear_, &open_}) list->clear();
  for (uint32_t c = 0; c < centres_.size; ++c) {
    if (sky_is_mapped_ && cluster_of(c).takes_maps_alone()) continue;
    // A light that cannot block its own samples is flat or convex, and does not light itself; by rounding its points
    // may lie on its bright side.
    if (centres_.instance[c] == candidates_.light.instance) continue;
    const int32_t shadow = candidates_.shadow[c];
    const bool is_settled = !shadow || shadow & k_light_blocked;
    if (is_settled && candidates_.met[c]) shared_->stats.samples_spared += candidates_.light_samples[c];
    (shadow & k_light_blocked ? dark_ : shadow ? open_ : clear_).push_back(c);
  }
  if (context_.answerer.checks()) check_whole();
}

void GroupLight::finish_light() {
  light_clear();
  if (!shared_->firsts.empty()) count_dark();
}

}  // namespace fieldtrace
