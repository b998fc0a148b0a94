#include "hybrid/light/direct_light.h"

#include <algorithm>
#include <cmath>

#include "hybrid/stats/stopwatch.h"

namespace fieldtrace {
namespace {

// StrataSeen::share of strata that are undecided; the second where every light sample must be taken.
constexpr float k_undecided = -1.0f, k_undecided_thin = -2.0f;
// What is known of a stratum whose first samples disagree.
constexpr float k_mixed = 0.5f;

void select_points(const ShadingPointBatch& all, std::span<const uint32_t> indices, ShadingPointBatch& chosen) {
  chosen.resize(indices.size());
  const auto select = [&](auto member) {
    const auto& from = all.*member;
    auto& to = chosen.*member;
    for (size_t i = 0; i < indices.size(); ++i) to[i] = from[indices[i]];
  };
  using B = ShadingPointBatch;
  for (const auto member :
       {&B::px, &B::py, &B::pz, &B::gx, &B::gy, &B::gz, &B::sx, &B::sy, &B::sz, &B::error, &B::radius}) {
    select(member);
  }
  for (const auto member : {&B::seed, &B::sample, &B::instance}) select(member);
  select(&B::transmits);
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

bool DirectLight::sees_whole(const Job& job, const PathVertex& v) const {
  const Vec3& p = v.surface->position;
  return v.material->plain_diffuse() && is_above(job, p, v.frame.n, 0.0f) && is_above(job, p, v.facing, 0.0f);
}

void DirectLight::add_irradiance(const Job& job, uint32_t vertex, float irradiance, float decided, float clear) const {
  const PathVertex& v = job.vertices[vertex];
  job.arriving[vertex] +=
      value_of(context_.lights.lights[job.light]) * v.material->reflectance * (std::max(irradiance, 0.0f) / k_pi);
  if (job.firsts.empty()) return;
  FirstHit& first = job.firsts[job.paths[v.path].slot];
  first.shadow_rays += decided * float(job.light_samples);
  first.shadow_clear += clear * float(job.light_samples);
}

void DirectLight::select_vertices(const Job& job, std::span<const Sampled> batch) {
  selected_.resize(batch.size());
  for (size_t i = 0; i < batch.size(); ++i) {
    const PathVertex& v = job.vertices[batch[i].vertex];
    set_shading_point(v, job.paths[v.path].index, i, selected_);
  }
}

void DirectLight::add_cluster_irradiance(const Job& job) {
  const Light& light = context_.lights.lights[job.light];
  select_points(points_, clear_, selected_);
  irradiance_vectors(light, selected_, context_.settings.isa, vectors_);
  for (size_t r = 0; r < clear_.size(); ++r) {
    const Vec3 vector(vectors_.x[r], vectors_.y[r], vectors_.z[r]);
    for (const uint32_t m : members(job, clear_[r])) {
      const PathVertex& v = job.vertices[m];
      if (vectors_.known[r] && sees_whole(job, v)) {
        add_irradiance(job, m, glm::dot(v.frame.n, vector), 1.0f, 1.0f);
      } else {
        sampled_.push_back({m, clear_[r]});
      }
    }
  }
}

void DirectLight::add_vertex_irradiance(const Job& job) {
  std::vector<Sampled> diffuse;
  for (const uint32_t cluster : clear_) {
    for (const uint32_t m : members(job, cluster)) {
      (job.vertices[m].material->plain_diffuse() ? diffuse : sampled_).push_back({m, cluster});
    }
  }
  select_vertices(job, diffuse);
  whole_irradiance(context_.lights.lights[job.light], selected_, context_.settings.isa, irradiance_);
  for (size_t i = 0; i < diffuse.size(); ++i) {
    if (irradiance_[i] >= 0.0f) {
      add_irradiance(job, diffuse[i].vertex, irradiance_[i], 1.0f, 1.0f);
    } else {
      sampled_.push_back(diffuse[i]);
    }
  }
}

void DirectLight::light_clear(const Job& job) {
  sampled_.clear();
  if (!context_.closed_form[job.light]) {
    for (const uint32_t cluster : clear_) {
      for (const uint32_t m : members(job, cluster)) sampled_.push_back({m, cluster});
    }
  } else if (context_.settings.estimates) {
    add_cluster_irradiance(job);
  } else {
    add_vertex_irradiance(job);
  }
  sample(job, false);
}

DirectLight::StrataSeen DirectLight::strata_seen(const Job& job, uint32_t cluster, size_t first_slot) const {
  const Vec3 p(points_.px[cluster], points_.py[cluster], points_.pz[cluster]);
  const Vec3 g(points_.gx[cluster], points_.gy[cluster], points_.gz[cluster]);
  const Vec3 s(points_.sx[cluster], points_.sy[cluster], points_.sz[cluster]);
  const float margin = points_.radius[cluster];
  StrataSeen seen;
  seen.whole = context_.closed_form[job.light] && is_above(job, p, g, margin) && is_above(job, p, s, margin);
  constexpr float k_part = 1.0f / float(k_strata);
  for (int k = 0; k < k_strata; ++k) {
    const size_t slot = first_slot + size_t(k);
    // Of a stratum whose centre lies below the horizon, a part may lie above.
    const bool is_active = shadows_.rays.tmax[slot] >= 0.0f;
    const uint8_t undecided = undecided_[slot];
    seen.whole = seen.whole && is_active;
    seen.share[k] = undecided == k_undecided_by_thin ? k_undecided_thin
                    : undecided != 0 || !is_active   ? k_undecided
                                                     : shadows_.clear[slot];
    if (seen.share[k] < 0.0f) continue;
    seen.decided += k_part;
    seen.clear += k_part * seen.share[k];
    seen.irradiance += glm::normalize(shadows_.rays.direction(slot)) * (k_part * seen.share[k] / shadows_.pdf[slot]);
  }
  return seen;
}

void DirectLight::filter_batch(const Job& job, std::span<const uint32_t> clusters) {
  select_points(points_, clusters, selected_);
  sample_light(context_.lights, job.light, selected_, {k_strata, 0, k_strata, k_strata_side}, context_.settings.isa,
               shadows_);
  job.stats.strata += shadows_.active;
  context_.answerer.filter(candidates_, points_, clusters, k_strata, shadows_, undecided_, job.stats);
  for (size_t r = 0; r < clusters.size(); ++r) {
    const uint32_t cluster = clusters[r];
    const StrataSeen seen = strata_seen(job, cluster, r * size_t(k_strata));
    for (size_t slot = r * k_strata; slot < (r + 1) * k_strata; ++slot) {
      job.stats.strata_refused += undecided_[slot] != 0 && shadows_.rays.tmax[slot] >= 0.0f;
    }
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
    job.stats.samples_spared += candidates_.light_samples[cluster];
    job.stats.samples_by_strata += candidates_.light_samples[cluster];
  }
}

void DirectLight::filter_strata(const Job& job) {
  seen_.clear();
  seen_of_.assign(points_.size, k_none);
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
    for (const uint32_t m : members(job, cluster)) {
      const PathVertex& v = job.vertices[m];
      const bool is_lit = seen && seen->whole && sees_whole(job, v);
      if (is_lit) add_irradiance(job, m, glm::dot(v.frame.n, seen->irradiance), seen->decided, seen->clear);
      if (is_lit && seen->decided == 1.0f) {
        job.stats.samples_spared += uint64_t(job.light_samples);
        job.stats.samples_by_strata += uint64_t(job.light_samples);
        continue;
      }
      sampled_.push_back({m, cluster, index, is_lit});
    }
  }
  sample(job, true);
}

void DirectLight::sample(const Job& job, bool may_be_hidden) {
  const size_t most = size_t(std::max(k_shadow_batch / job.light_samples, 1));
  for (size_t begin = 0, end = 0; begin < sampled_.size(); begin = end) {
    end = std::min(begin + most, sampled_.size());
    while (end < sampled_.size() && sampled_[end].cluster == sampled_[end - 1].cluster) ++end;
    const std::span<const Sampled> batch(sampled_.data() + begin, end - begin);
    {
      const ScopedTimer timer(job.stats.time_secondary);
      select_vertices(job, batch);
      LightSampleRange range = {job.light_samples, 0, job.light_samples};
      if (may_be_hidden && on_grid(job)) range.cell_columns = range.cell_rows = k_strata_side;
      sample_light(context_.lights, job.light, selected_, range, context_.settings.isa, shadows_);
      if (may_be_hidden) answer(job, batch);
    }
    job.stats.rays_shadow += shadows_.active;
    add_samples(job, batch);
  }
}

void DirectLight::sort_undecided(const Job& job, std::span<const Sampled> batch, bool on_grid) {
  const size_t m = size_t(job.light_samples);
  grids_.clear();
  traced_slots_.clear();
  waiting_.clear();
  first_cells_.clear();
  bool waits = false;
  uint32_t first_samples = 0;
  std::array<uint32_t, k_strata> taken;
  for (size_t i = 0; i < batch.size(); ++i) {
    const Sampled& s = batch[i];
    const float* shares = s.strata == k_none ? nullptr : seen_[s.strata].share;
    if (i == 0 || s.cluster != batch[i - 1].cluster) {
      grids_.emplace_back();
      grids_.back().fill(k_undecided);
      if (shares) std::copy_n(shares, k_strata, grids_.back().begin());
      // With one sample in most strata, agreement between neighbours would settle nothing.
      const uint32_t samples = candidates_.light_samples[s.cluster];
      waits = on_grid && context_.settings.adaptive && samples >= 2 * k_strata;
      first_samples = std::max(samples / (k_samples_per_first * k_strata), 1u);
      taken.fill(0);
    }
    for (size_t slot = i * m; slot < (i + 1) * m; ++slot) {
      if (shadows_.rays.tmax[slot] < 0.0f) continue;
      const auto cell = on_grid ? uint32_t(shadows_.cell[slot]) : 0u;
      const float share = shares ? shares[cell] : k_undecided;
      if (share >= 0.0f) {
        shadows_.clear[slot] = s.is_lit ? 0.0f : share;
        ++job.stats.samples_spared;
        ++job.stats.samples_by_strata;
      } else if (!waits || share == k_undecided_thin) {
        traced_slots_.push_back(uint32_t(slot));
        first_cells_.push_back({k_none, 0});
      } else if (taken[cell]++ < first_samples) {
        traced_slots_.push_back(uint32_t(slot));
        first_cells_.push_back({uint32_t(grids_.size() - 1), cell});
      } else {
        waiting_.push_back({uint32_t(slot), uint32_t(grids_.size() - 1), cell});
      }
    }
  }
}

void DirectLight::trace_slots(const Job& job) {
  traced_.resize(traced_slots_.size());
  for (size_t j = 0; j < traced_slots_.size(); ++j) {
    traced_.rays.copy(j, shadows_.rays, traced_slots_[j]);
    traced_.instance[j] = shadows_.instance[traced_slots_[j]];
  }
  context_.answerer.answer(candidates_, LightSeen::unknown, traced_, job.stats);
  for (size_t j = 0; j < traced_slots_.size(); ++j) {
    shadows_.clear[traced_slots_[j]] = traced_.blocked[j] ? 0.0f : 1.0f;
    shadows_.exact[traced_slots_[j]] = traced_.exact[j];
  }
}

// A stratum whose first samples agree, and with all that is known of the strata around it, is taken to be seen alike.
void DirectLight::settle_waiting(const Job& job) {
  for (size_t j = 0; j < traced_slots_.size(); ++j) {
    const auto [grid, cell] = first_cells_[j];
    if (grid == k_none) continue;
    float& known = grids_[grid][cell];
    const float clear = shadows_.clear[traced_slots_[j]];
    known = known == k_undecided || known == clear ? clear : k_mixed;
  }
  traced_slots_.clear();
  for (const Waiting& w : waiting_) {
    const std::array<float, k_strata>& grid = grids_[w.grid];
    const int column = int(w.cell) % k_strata_side, row = int(w.cell) / k_strata_side;
    const float value = grid[w.cell];
    bool agrees = value != k_mixed;
    for (int y = std::max(row - 1, 0); y <= std::min(row + 1, k_strata_side - 1); ++y) {
      for (int x = std::max(column - 1, 0); x <= std::min(column + 1, k_strata_side - 1); ++x) {
        const float other = grid[size_t(y * k_strata_side + x)];
        agrees = agrees && (other < 0.0f || other == value);
      }
    }
    if (agrees) {
      shadows_.clear[w.slot] = value;
      ++job.stats.samples_spared;
      ++job.stats.samples_extrapolated;
    } else {
      traced_slots_.push_back(w.slot);
    }
  }
}

void DirectLight::answer(const Job& job, std::span<const Sampled> batch) {
  const bool grid = on_grid(job);
  const bool is_known = std::any_of(batch.begin(), batch.end(), [](const Sampled& s) { return s.strata != k_none; });
  if (!is_known && !(context_.settings.adaptive && grid)) {
    context_.answerer.answer(candidates_, LightSeen::unknown, shadows_, job.stats);
    return;
  }
  shadows_.in_shares = true;
  shadows_.clear.assign(padded(shadows_.rays.size), 0.0f);
  sort_undecided(job, batch, grid);
  trace_slots(job);
  if (waiting_.empty()) return;
  settle_waiting(job);
  trace_slots(job);
}

void DirectLight::add_samples(const Job& job, std::span<const Sampled> batch) {
  const Light& light = context_.lights.lights[job.light];
  const LightEstimate estimate = {value_of(light), job.light_samples, context_.closed_form[job.light] != 0,
                                  light.kind == LightKind::environment};
  const size_t m = size_t(job.light_samples);
  for (size_t i = 0; i < batch.size(); ++i) {
    const Sampled& s = batch[i];
    const PathVertex& v = job.vertices[s.vertex];
    job.arriving[s.vertex] += reflected_light(shadows_, i * m, job.light_samples, estimate, v);
    if (job.firsts.empty()) continue;
    FirstHit& first = job.firsts[job.paths[v.path].slot];
    for (size_t slot = i * m; slot < (i + 1) * m; ++slot) {
      if (shadows_.rays.tmax[slot] < 0.0f) continue;
      if (s.is_lit && seen_[s.strata].share[shadows_.cell[slot]] >= 0.0f) continue;  // counted by its share
      first.shadow_rays += 1.0f;
      first.shadow_clear += shadows_.in_shares ? shadows_.clear[slot] : float(!shadows_.blocked[slot]);
      first.shadow_exact += float(shadows_.exact[slot]);
    }
  }
}

// For the layers: only sampling tells which samples of vertices that see nothing would have become rays.
void DirectLight::count_dark(const Job& job) {
  sampled_.clear();
  for (const uint32_t cluster : dark_) {
    for (const uint32_t m : members(job, cluster)) sampled_.push_back({m, cluster});
  }
  const size_t m = size_t(job.light_samples), most = size_t(std::max(k_shadow_batch / job.light_samples, 1));
  for (size_t begin = 0; begin < sampled_.size(); begin += most) {
    const std::span<const Sampled> batch(sampled_.data() + begin, std::min(most, sampled_.size() - begin));
    select_vertices(job, batch);
    sample_light(context_.lights, job.light, selected_, job.light_samples, context_.settings.isa, shadows_);
    for (size_t slot = 0; slot < batch.size() * m; ++slot) {
      const PathVertex& v = job.vertices[batch[slot / m].vertex];
      job.firsts[job.paths[v.path].slot].shadow_rays += float(shadows_.rays.tmax[slot] >= 0.0f);
    }
  }
}

void DirectLight::check(const Job& job) {
  for (const bool blocked : {false, true}) {
    sampled_.clear();
    std::vector<uint32_t> cluster_of;
    for (const uint32_t cluster : blocked ? dark_ : clear_) {
      for (const uint32_t m : members(job, cluster)) {
        sampled_.push_back({m, cluster});
        cluster_of.push_back(cluster);
      }
    }
    if (sampled_.empty()) continue;
    select_vertices(job, sampled_);
    sample_light(context_.lights, job.light, selected_, job.light_samples, context_.settings.isa, shadows_);
    context_.answerer.check_whole(candidates_, blocked, cluster_of, job.light_samples, shadows_, job.stats);
  }
}

void DirectLight::gather_light(const Job& job) {
  Stats& stats = job.stats;
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    for (auto* list : {&dark_, &clear_, &open_}) list->clear();
    candidates_.light = context_.light_extents[job.light];
    context_.answerer.find_candidates(points_, candidates_, stats);
    for (uint32_t c = 0; c < points_.size; ++c) {
      const int32_t shadow = candidates_.shadow[c];
      const bool is_settled = !shadow || shadow & k_light_blocked;
      if (is_settled && candidates_.met[c]) stats.samples_spared += candidates_.light_samples[c];
      (shadow & k_light_blocked ? dark_ : shadow ? open_ : clear_).push_back(c);
    }
  }
  if (context_.answerer.checks()) check(job);
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
  clusters_.points(job.vertices, job.begin, job.end, points_);
  candidates_.light_samples.resize(points_.size);
  for (uint32_t c = 0; c < points_.size; ++c) {
    candidates_.light_samples[c] = clusters_[job.begin + c].size() * uint32_t(job.light_samples);
  }
  for (job.light = 0; job.light < context_.lights.size(); ++job.light) {
    if (context_.lights.lights[job.light].kind != LightKind::none) gather_light(job);
  }
}

void DirectLight::gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
                         bool first, std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats) {
  std::fill(arriving.begin(), arriving.end(), Rgb(0.0f));
  const int pixel_samples = first ? context_.settings.pixel_samples : 1;
  candidates_.few_samples = int64_t(pixel_samples) * light_samples < k_fewest_cone_samples;
  const auto most = uint32_t(std::max(2 * k_shadow_batch / light_samples, 1));
  clusters_.build(vertices, context_.light_extents, most, candidates_.few_samples || pixel_samples == 1);
  Job job{vertices, paths, light_samples, firsts, arriving, stats};
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
