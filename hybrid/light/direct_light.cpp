#include "hybrid/light/direct_light.h"

#include <algorithm>
#include <cmath>

#include "core/light/light_irradiance.h"
#include "hybrid/stats/stopwatch.h"

namespace fieldtrace {

void DirectLight::select_shading_points(const ShadingPointBatch& all, std::span<const uint32_t> indices,
                                        ShadingPointBatch& chosen) {
  chosen.resize(indices.size());
  const auto select = [&](auto member) {
    const auto& from = all.*member;
    auto& to = chosen.*member;
    for (size_t i = 0; i < indices.size(); ++i) to[i] = from[indices[i]];
  };
  using B = ShadingPointBatch;
  for (const auto member : {&B::px, &B::py, &B::pz, &B::gx, &B::gy, &B::gz, &B::sx, &B::sy, &B::sz, &B::error}) {
    select(member);
  }
  for (const auto member : {&B::seed, &B::sample, &B::instance}) select(member);
  select(&B::transmits);
}

LightSampleRange stratum_grid(int light_samples) {
  const int wanted = std::max(light_samples / k_samples_per_stratum, k_fewest_strata);
  const int most = std::min({wanted, light_samples, k_most_grid_strata});
  const int columns = int(std::sqrt(float(most)));
  const int strata = most / columns * columns;
  return {strata, 0, strata, columns};
}

LightEstimate DirectLight::estimate_of(const Job& job, int mean_of) const {
  const Light& light = context_.lights.lights[job.light];
  return {{light.value[0], light.value[1], light.value[2]},
          job.light_samples,
          mean_of,
          context_.closed_form[job.light] != 0,
          light.kind == LightKind::environment};
}

void DirectLight::place_shading_points(const Job& job, const Part& part) {
  if (part.begin == places_part_.begin && part.end == places_part_.end) return;
  places_part_ = part;
  places_.resize(part.end - part.begin);
  for (size_t r = 0; r < places_.size; ++r) {
    const PathVertex& v = job.vertices[lit_[part.begin + r]];
    const Vec3& p = v.surface->position;
    places_.px[r] = p.x, places_.py[r] = p.y, places_.pz[r] = p.z;
    places_.gx[r] = v.facing.x, places_.gy[r] = v.facing.y, places_.gz[r] = v.facing.z;
    places_.sx[r] = v.frame.n.x, places_.sy[r] = v.frame.n.y, places_.sz[r] = v.frame.n.z;
    places_.error[r] = v.surface->error;
    places_.seed[r] = v.seed;
    places_.sample[r] = job.paths[v.path].index;
    places_.instance[r] = v.surface->instance;
    places_.transmits[r] = v.material->transmits();
  }
}

const ShadingPointBatch& DirectLight::selected(std::span<const uint32_t> indices) {
  if (indices.size() == places_.size && std::is_sorted(indices.begin(), indices.end())) return places_;
  select_shading_points(places_, indices, shading_points_);
  return shading_points_;
}

void DirectLight::sample_group(const Job& job, const LightSampleRange& range) {
  sample_light(context_.lights, job.light, selected(group_), range, context_.settings.isa, shadows_);
}

void DirectLight::add_shading_point(const Job& job, const LightEstimate& light, size_t r, int samples) {
  const PathVertex& v = vertex_of(job, group_[r]);
  const size_t begin = r * size_t(samples), end = begin + size_t(samples);
  job.arriving[lit_[places_part_.begin + group_[r]]] += reflected_light(shadows_, begin, samples, light, v);
  if (job.firsts.empty()) return;
  FirstHit& first = job.firsts[job.paths[v.path].slot];
  const float weight = shadows_.in_shares ? float(job.light_samples) / float(samples) : 1.0f;
  for (size_t i = begin; i < end; ++i) {
    if (shadows_.rays.tmax[i] < 0.0f) continue;
    first.shadow_rays += weight;
    first.shadow_clear += weight * (shadows_.in_shares ? shadows_.clear[i] : float(!shadows_.blocked[i]));
    first.shadow_exact += float(shadows_.exact[i]);
  }
}

void DirectLight::add_group(const Job& job, int samples) {
  job.stats.rays_shadow += shadows_.active;
  const LightEstimate light = estimate_of(job, job.light_samples);
  for (size_t r = 0; r < group_.size(); ++r) add_shading_point(job, light, r, samples);
}

void DirectLight::split_shading_points(const Job& job) {
  shadowed_.clear();
  free_.clear();
  dark_.clear();
  candidates_.light = context_.light_extents[job.light];
  candidates_.light_samples = job.light_samples;
  context_.answerer.find_candidates(places_, candidates_, job.stats);
  for (uint32_t r = 0; r < places_.size; ++r) {
    const int32_t shadow = candidates_.shadow[r];
    (shadow & k_light_blocked ? dark_ : shadow ? shadowed_ : free_).push_back(r);
  }
}

bool DirectLight::split(const Job& job, const Part& part) {
  const size_t smallest = size_t(std::max(k_smallest_part_rays / job.light_samples, 1));
  if (job.light_samples < k_fewest_splitting_samples || part.end - part.begin <= smallest) return false;
  if (!context_.answerer.gains_by_splitting(candidates_)) return false;
  if (!in_split_order_) {
    // The batch's first split: the part is the whole batch.
    placed_.clear();
    for (size_t i = part.begin; i < part.end; ++i) {
      placed_.push_back({job.vertices[lit_[i]].surface->position, lit_[i]});
    }
    order_by_median_splits(placed_, smallest);
    for (size_t i = part.begin; i < part.end; ++i) lit_[i] = placed_[i - part.begin].index;
    in_split_order_ = true;
    places_part_ = {};
  }
  const size_t middle = middle_of(part.begin, part.end);
  parts_.push_back({middle, part.end});
  parts_.push_back({part.begin, middle});
  return true;
}

void DirectLight::check_split(const Job& job) {
  for (const bool blocked : {false, true}) {
    group_ = blocked ? dark_ : free_;
    if (group_.empty()) continue;
    const LightSampleRange samples = all_samples(job);
    sample_group(job, samples);
    context_.answerer.check_whole(candidates_, blocked, group_, samples.count, shadows_, job.stats);
  }
}

void DirectLight::filter_strata(const Job& job, const LightSampleRange& strata, bool last) {
  group_.swap(filtered_);
  filtered_.clear();
  if (group_.empty()) return;
  const size_t count = size_t(strata.count);
  sample_group(job, strata);
  context_.answerer.filter(candidates_, group_, strata.count, shadows_, refused_, job.stats);
  job.stats.strata += shadows_.active;
  const LightEstimate light = estimate_of(job, strata.total);
  for (size_t r = 0; r < group_.size(); ++r) {
    int active = 0, clear = 0, hidden = 0;
    for (size_t i = r * count; i < (r + 1) * count; ++i) {
      if (shadows_.rays.tmax[i] < 0.0f) continue;
      ++active;
      clear += shadows_.clear[i] == 1.0f;
      hidden += shadows_.clear[i] == 0.0f;
    }
    if (refused_[r]) {
      (refused_[r] == k_refused_by_thin ? penumbrae_ : shadowed_).push_back(group_[r]);
      job.stats.strata_refused += uint64_t(active);
      continue;
    }
    const bool agrees = active != 0 && (clear == active || hidden == active);
    if (!agrees && !last) {
      filtered_.push_back(group_[r]);
      continue;
    }
    job.stats.samples_spared += uint64_t(job.light_samples);
    context_.answerer.count_filtered(candidates_, group_[r], job.stats);
    if (agrees) {
      (clear != 0 ? free_ : dark_).push_back(group_[r]);
    } else {
      add_shading_point(job, light, r, strata.count);
    }
    if (clear != active) job.stats.rays_shadow += uint64_t(active);  // gather_free() counts those of free_
  }
}

bool DirectLight::is_wide(uint32_t place) const {
  return angular_diameter(candidates_.light, {places_.px[place], places_.py[place], places_.pz[place]}) >
         k_coarse_light_degrees;
}

void DirectLight::query_strata(const Job& job) {
  // With so few samples that probe rays are not worth their cost, strata filter wide lights, too: they err less than
  // the samples would.
  const bool tries_wide = probe_rays(context_.lights.lights[job.light].kind, job.light_samples, true).count > 0;
  std::vector<uint32_t> lobed;  // not on a grid: a lobe may be narrower than its cells
  size_t kept = 0;
  for (const uint32_t r : shadowed_) {
    if (candidates_.by_rays[r] || (tries_wide && is_wide(r))) {
      shadowed_[kept++] = r;
    } else {
      (vertex_of(job, r).material->plain_diffuse() ? filtered_ : lobed).push_back(r);
    }
  }
  if (kept == shadowed_.size()) return;
  shadowed_.resize(kept);
  // Points of mesh lights take a third random number, so no grid cuts these lights into strata.
  const bool is_plane = context_.lights.lights[job.light].kind != LightKind::mesh;
  const LightSampleRange grid = stratum_grid(job.light_samples), first = stratum_grid(k_first_strata);
  const bool on_grid = is_plane && job.light_samples >= k_fewest_grid_samples;
  if (on_grid && 3 * first.total <= 2 * grid.total) filter_strata(job, first, false);
  filter_strata(job, on_grid ? grid : all_samples(job), true);
  filtered_.swap(lobed);
  filter_strata(job, all_samples(job), true);
  std::sort(shadowed_.begin(), shadowed_.end());
}

void DirectLight::gather_shadowed(const Job& job, LightSeen seen) {
  group_.swap(shadowed_);
  if (group_.empty()) return;
  {
    const ScopedTimer timer(job.stats.time_secondary);
    sample_group(job, all_samples(job));
    context_.answerer.answer(candidates_, seen, shadows_, job.stats);
  }
  add_group(job, job.light_samples);
}

void DirectLight::gather_closed(const Job& job) {
  if (!context_.closed_form[job.light]) return;
  const Light& light = context_.lights.lights[job.light];
  const Rgb value(light.value[0], light.value[1], light.value[2]);
  whole_irradiance(light, selected(free_), context_.settings.isa, irradiance_);
  size_t kept = 0;
  for (size_t i = 0; i < free_.size(); ++i) {
    const uint32_t r = free_[i];
    const PathVertex& v = vertex_of(job, r);
    if (!(irradiance_[i] >= 0.0f) || !v.material->plain_diffuse()) {
      free_[kept++] = r;
      continue;
    }
    job.arriving[lit_[places_part_.begin + r]] += value * v.material->reflectance * (irradiance_[i] / k_pi);
    if (job.firsts.empty()) continue;
    FirstHit& first = job.firsts[job.paths[v.path].slot];
    first.shadow_rays += float(job.light_samples);
    first.shadow_clear += float(job.light_samples);
  }
  free_.resize(kept);
}

// Shading points that nothing shadows send no shadow rays; their light samples only shade.
void DirectLight::gather_free(const Job& job) {
  gather_closed(job);
  group_.swap(free_);
  if (group_.empty()) return;
  sample_group(job, all_samples(job));
  add_group(job, job.light_samples);
}

// Only sampling tells which of their samples would have become rays.
void DirectLight::count_dark(const Job& job) {
  group_.swap(dark_);
  if (group_.empty()) return;
  sample_group(job, all_samples(job));
  for (size_t r = 0; r < group_.size(); ++r) {
    FirstHit& first = job.firsts[job.paths[vertex_of(job, group_[r]).path].slot];
    for (size_t i = r * size_t(job.light_samples); i < (r + 1) * size_t(job.light_samples); ++i) {
      first.shadow_rays += float(shadows_.rays.tmax[i] >= 0.0f);
    }
  }
}

void DirectLight::gather_part(const Job& job, const Part& part) {
  Stats& stats = job.stats;
  const double bake_before = stats.time_bake;
  place_shading_points(job, part);
  {
    const ScopedTimer timer(stats.time_secondary);
    split_shading_points(job);
    if (split(job, part)) return;  // nothing has been baked yet: there are too many candidates
  }
  if (context_.answerer.checks()) check_split(job);
  // Under a light all around, most shading points see a little less than all of it: letting a few samples that agree
  // stand for the rest would brighten them.
  const bool has_edges = candidates_.light.kind == LightExtent::Kind::bounded;
  if (context_.answerer.extrapolates(candidates_) && has_edges && !shadowed_.empty()) {
    const ScopedTimer timer(stats.time_secondary);
    query_strata(job);
    const LightKind kind = context_.lights.lights[job.light].kind;
    const LightSampleRange narrow = probe_rays(kind, job.light_samples, false);
    const LightSampleRange wide = probe_rays(kind, job.light_samples, true);
    query_probe_rays(job, narrow, narrow.count == wide.count ? Probed::all : Probed::narrow);
    if (narrow.count != wide.count) query_probe_rays(job, wide, Probed::wide);
  }
  gather_shadowed(job, LightSeen::unknown);
  shadowed_.swap(penumbrae_);
  penumbrae_.clear();
  gather_shadowed(job, LightSeen::in_part);
  stats.time_secondary -= stats.time_bake - bake_before;
  gather_free(job);
  if (!job.firsts.empty()) count_dark(job);
}

void DirectLight::gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
                         std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats) {
  lit_.clear();
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    arriving[i] = Rgb(0.0f);
    const Material& material = *vertices[i].material;
    if (!material.delta() && !material.dark) lit_.push_back(i);
  }
  places_part_ = {};
  Job job{vertices, paths, light_samples, firsts, arriving, stats};
  const size_t group_size = size_t(std::max(k_shadow_batch / light_samples, 1));
  for (size_t begin = 0; begin < lit_.size(); begin += group_size) {
    const size_t end = std::min(begin + group_size, lit_.size());
    in_split_order_ = false;
    for (job.light = 0; job.light < context_.lights.size(); ++job.light) {
      if (context_.lights.lights[job.light].kind == LightKind::none) continue;
      parts_.assign(1, {begin, end});
      while (!parts_.empty()) {
        const Part part = parts_.back();
        parts_.pop_back();
        gather_part(job, part);
      }
    }
  }
}

}  // namespace fieldtrace
