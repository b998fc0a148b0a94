// Probe rays: a few points of a light, tried before all of its samples. They settle whole lights, and lights that one
// edge cuts.
#include <algorithm>
#include <cmath>

#include "core/sampling/sobol.hd.h"
#include "hybrid/light/direct_light.h"

namespace fieldtrace {
namespace {

// Whether the border of the light's sample square is the light's rim, from wherever it is seen.
bool has_rim(LightKind kind) {
  return kind == LightKind::sphere || kind == LightKind::disk || kind == LightKind::rectangle ||
         kind == LightKind::parallelogram;
}

// A number in [1/4, 3/4) for each shading point: where a line or a cell is probed, so that what a lattice cannot
// resolve varies from pixel to pixel and shows as faint noise, not as steps.
float jitter(const ShadingPointBatch& shading_points, uint32_t shading_point, int number) {
  using scalar::hash_uint;
  const uint32_t hash = hash_uint(hash_uint(shading_points.seed[shading_point] + uint32_t(number)) +
                                  shading_points.sample[shading_point]);
  return 0.25f + 0.5f * float(hash >> 8) * 0x1p-24f;
}

// How far beside a straight piece of an edge, in cells, the edge is verified.
constexpr float k_edge_margin = 0.2f;

}  // namespace

LightSampleRange probe_rays(LightKind kind, int light_samples, bool is_wide) {
  const int rounded = int(std::lround(std::sqrt(2.0 * std::sqrt(double(light_samples)))));
  const int side = is_wide ? std::max(rounded, k_least_wide_lattice) : rounded, n = side * side;
  if (side < k_least_lattice || 5 * n > 3 * light_samples) return {0, 0, 0};
  if (!has_rim(kind)) return {light_samples, 0, n};
  return {n, 0, n, side, k_lattice_extent * float(side) / float(side - 1)};
}

void DirectLight::query_probe_rays(const Job& job, const LightSampleRange& points, Probed tried) {
  if (points.count == 0) return;
  group_.clear();
  fields_before_.clear();
  std::erase_if(shadowed_, [&](uint32_t r) {
    if (tried != Probed::all && is_wide(r) != (tried == Probed::wide)) return false;
    const uint32_t fields = context_.answerer.fields_before(candidates_, places_, r);
    if (fields == 0) return false;
    group_.push_back(r);
    fields_before_.push_back(fields);
    return true;
  });
  if (group_.empty()) return;
  const size_t count = size_t(points.count);
  sample_group(job, points);
  context_.answerer.answer(candidates_, LightSeen::unknown, shadows_, job.stats);
  edged_.clear();
  lattices_.clear();
  const bool doubts_fields = context_.answerer.doubts_depth(candidates_, LightSeen::in_part);
  for (size_t r = 0; r < group_.size(); ++r) {
    const size_t begin = r * count;
    size_t active = 0, blocked = 0, exact = 0;
    for (size_t i = begin; i < begin + count; ++i) {
      active += shadows_.rays.tmax[i] >= 0.0f;
      blocked += shadows_.blocked[i];
      exact += shadows_.exact[i];
    }
    const bool agrees = blocked == 0 || blocked == active;
    // Where the light sinks below the horizon, too few points of it are probed.
    const bool is_settled = agrees && 2 * active >= count;
    // gather_free() counts the samples of free_.
    if (!is_settled || blocked != 0) job.stats.rays_shadow += active;
    if (is_settled) {
      (blocked == 0 ? free_ : dark_).push_back(group_[r]);
      count_extrapolated(job, group_[r], fields_before_[r], count, exact);
    } else if (agrees) {
      shadowed_.push_back(group_[r]);
    } else if (points.columns == 0 || !vertex_of(job, group_[r]).material->plain_diffuse()) {
      penumbrae_.push_back(group_[r]);  // a material's lobe may be narrower than a lattice's cell
    } else {
      edged_.push_back({group_[r], fields_before_[r], uint32_t(active), uint32_t(count), uint32_t(exact),
                        mean_by_corners(begin, points.columns), LightMean()});
      for (size_t i = begin; i < begin + count; ++i) {
        const bool is_certain = !doubts_fields || shadows_.rays.tmax[i] < 0.0f || shadows_.exact[i];
        lattices_.push_back(uint8_t(is_hidden(i) ? 1 : 0) | (is_certain ? uint8_t(0) : k_untraced));
      }
    }
  }
  if (!edged_.empty()) follow_edges(job, points.columns);
}

// By the trapezoidal rule: points on the rim stand for halves of cells, corners for quarters.
DirectLight::LightMean DirectLight::mean_by_corners(size_t begin, int side) const {
  LightMean mean;
  const float cells = float((side - 1) * (side - 1));
  const auto part = [side](int i) { return i == 0 || i == side - 1 ? 0.5f : 1.0f; };
  for (int i = 0; i < side * side; ++i) mean.add(shadows_, begin + size_t(i), part(i % side) * part(i / side) / cells);
  return mean;
}

void DirectLight::count_extrapolated(const Job& job, uint32_t shading_point, uint32_t fields, size_t queried,
                                     size_t exact) {
  const uint64_t rest = uint64_t(std::max(job.light_samples - int(queried), 0));
  job.stats.samples_spared += rest;
  job.stats.samples_extrapolated += rest;
  const uint64_t traced = rest * exact / queried;
  context_.answerer.count_extrapolated(candidates_, fields, places_.instance[shading_point], rest - traced, traced,
                                       job.stats);
}

void DirectLight::clear_points() {
  owners_.clear();
  point_places_.clear();
  point_x_.clear();
  point_y_.clear();
}

void DirectLight::place_point(uint32_t owner, const SquarePoint& at) {
  owners_.push_back(owner);
  point_places_.push_back(edged_[owner].shading_point);
  point_x_.push_back(at.x * k_lattice_extent);
  point_y_.push_back(at.y * k_lattice_extent);
}

void DirectLight::sample_points(const Job& job) {
  point_x_.resize(padded(owners_.size()));
  point_y_.resize(padded(owners_.size()));
  select_shading_points(places_, point_places_, shading_points_);
  sample_light(context_.lights, job.light, shading_points_, {1, 0, 1, 0, 1.0f, point_x_.data(), point_y_.data()},
               context_.settings.isa, shadows_);
}

void DirectLight::query_points(const Job& job) {
  if (owners_.empty()) return;
  sample_points(job);
  context_.answerer.answer(candidates_, LightSeen::in_part, shadows_, job.stats);
  job.stats.rays_shadow += shadows_.active;
  for (size_t i = 0; i < owners_.size(); ++i) edged_[owners_[i]].exact += shadows_.exact[i];
}

void DirectLight::count_queried() {
  for (const uint32_t owner : owners_) ++edged_[owner].queried;
}

// A cell that is right about most rays may be wrong about many of one shading point (docs/decisions/019-penumbrae.md).
void DirectLight::query_lattices_again(const Job& job, int side) {
  const size_t count = size_t(side) * size_t(side);
  clear_points();
  std::vector<size_t>& queried = found_;
  queried.clear();
  for (size_t i = 0; i < lattices_.size(); ++i) {
    if (!(lattices_[i] & k_untraced)) continue;
    place_point(uint32_t(i / count), lattice_point(int(i % count), side));
    queried.push_back(i);
  }
  query_points(job);
  for (size_t i = 0; i < queried.size(); ++i) lattices_[queried[i]] = is_hidden(i);
}

// Where the light's weight varies smoothly, the two rules (trapezoidal and midpoint) differ by three times the error of
// the midpoint rule; together (Simpson's rule) they give the weight of the whole light.
void DirectLight::weigh_cells(const Job& job, int side) {
  const size_t count = size_t(side) * size_t(side);
  const float cells = float((side - 1) * (side - 1));
  clear_points();
  for (uint32_t e = 0; e < edged_.size(); ++e) {
    if (!edged_[e].is_followed) continue;
    for (int i = 0; i < int(count); ++i) {
      if (i % side + 1 < side && i / side + 1 < side) place_point(e, point_in(i, side, 0.5f, 0.5f));
    }
  }
  if (owners_.empty()) return;
  sample_points(job);
  for (size_t i = 0; i < owners_.size(); ++i) edged_[owners_[i]].by_middles.add(shadows_, i, 1.0f / cells);
  for (EdgedShadingPoint& e : edged_) {
    const float difference = std::abs(e.by_corners.weight - e.by_middles.weight);
    e.is_followed = e.is_followed && difference <= k_most_uneven * e.by_middles.weight;
  }
}

// Probes inside the cells find most of what passes between the points of a lattice.
void DirectLight::query_witnesses(const Job& job, int side) {
  const size_t count = size_t(side) * size_t(side);
  clear_points();
  std::vector<size_t>& corners = found_;  // of the cells that are probed
  corners.clear();
  for (uint32_t e = 0; e < edged_.size(); ++e) {
    if (!edged_[e].is_followed) continue;
    const uint32_t shading_point = edged_[e].shading_point;
    for (const int corner : even_cells(lattice(e, count), side)) {
      place_point(e, point_in(corner, side, jitter(places_, shading_point, 2 * corner),
                              jitter(places_, shading_point, 2 * corner + 1)));
      corners.push_back(e * count + size_t(corner));
    }
  }
  query_points(job);
  count_queried();
  for (size_t i = 0; i < corners.size(); ++i) {
    if (is_hidden(i) != (lattices_[corners[i]] != 0)) edged_[owners_[i]].is_followed = false;
  }
}

void DirectLight::follow_edges(const Job& job, int side) {
  const size_t count = size_t(side) * size_t(side);
  const int bisection_steps = edge_bisection_steps(side, job.light_samples);
  query_lattices_again(job, side);
  crossings_.clear();
  for (uint32_t e = 0; e < edged_.size(); ++e) {
    const size_t begin = crossings_.size();
    const bool mostly_traced = 2 * edged_[e].exact >= edged_[e].active;
    if (!mostly_traced || !find_crossings(lattice(e, count), side, e, crossings_)) continue;
    // Not where taking all samples costs no more. One more line is crossed than cells; crossed cells take two
    // witnesses, the others one.
    const size_t lines = crossings_.size() - begin, cells = size_t(side - 1) * size_t(side - 1);
    const size_t points = lines * size_t(bisection_steps) + cells + lines - 1;
    edged_[e].is_followed = points < size_t(job.light_samples);
  }
  weigh_cells(job, side);
  query_witnesses(job, side);
  std::erase_if(crossings_, [this](const EdgeCrossing& c) { return !edged_[c.owner].is_followed; });
  narrow_crossings(job, side, bisection_steps);
  measure_edges(side);
  query_beside_edges(job, side, bisection_steps);
  add_edged(job, side);
  for (const EdgedShadingPoint& e : edged_) {
    if (!e.is_followed) penumbrae_.push_back(e.shading_point);
  }
}

void DirectLight::narrow_crossings(const Job& job, int side, int bisection_steps) {
  std::vector<float>& places = places_on_;
  places.resize(crossings_.size());
  for (int i = 0; i < bisection_steps; ++i) {
    clear_points();
    for (size_t k = 0; k < crossings_.size(); ++k) {
      const EdgeCrossing& c = crossings_[k];
      const int line = 2 * c.point + (c.down ? 1 : 0);
      places[k] = i == 0 ? jitter(places_, edged_[c.owner].shading_point, line) : c.middle();
      place_point(c.owner, point_on(c, side, places[k]));
    }
    query_points(job);
    count_queried();
    for (size_t k = 0; k < crossings_.size(); ++k) crossings_[k].narrow(places[k], is_hidden(k));
  }
}

void DirectLight::measure_edges(int side) {
  const size_t points = size_t(side) * size_t(side), cells = size_t(side - 1) * size_t(side - 1);
  cells_seen_.resize(edged_.size() * cells);
  for (size_t begin = 0, end = 0; begin < crossings_.size(); begin = end) {
    const uint32_t owner = crossings_[begin].owner;
    while (end < crossings_.size() && crossings_[end].owner == owner) ++end;
    measure_cells(lattice(owner, points), side, std::span(crossings_).subspan(begin, end - begin),
                  std::span(cells_seen_).subspan(owner * cells, cells));
  }
}

// Straight pieces miss corners of an edge, and second edges through the same cells.
void DirectLight::query_beside_edges(const Job& job, int side, int bisection_steps) {
  const size_t cells = size_t(side - 1) * size_t(side - 1);
  const float away = k_edge_margin + 0.75f * std::ldexp(1.0f, -bisection_steps);  // plus how well crossings are known
  clear_points();
  std::vector<size_t>& expected = found_;  // 1: hidden
  expected.clear();
  for (uint32_t e = 0; e < edged_.size(); ++e) {
    if (!edged_[e].is_followed) continue;
    for (size_t i = 0; i < cells; ++i) {
      const CellSeen& cell = cells_seen_[e * cells + i];
      if (!cell.is_crossed) continue;
      const int corner = int(i) / (side - 1) * side + int(i) % (side - 1);
      for (const bool hidden : {false, true}) {
        const SquarePoint at = cell.beside_middle(hidden ? away : -away);
        if (std::max(std::abs(at.x - 0.5f), std::abs(at.y - 0.5f)) > 0.5f) continue;
        place_point(e, point_in(corner, side, at.x, at.y));
        expected.push_back(hidden);
      }
    }
  }
  query_points(job);
  count_queried();
  for (size_t i = 0; i < expected.size(); ++i) {
    if (is_hidden(i) != (expected[i] != 0)) edged_[owners_[i]].is_followed = false;
  }
}

void DirectLight::add_edged(const Job& job, int side) {
  const size_t points = size_t(side) * size_t(side), cells = size_t(side - 1) * size_t(side - 1);
  clear_points();
  for (uint32_t e = 0; e < edged_.size(); ++e) {
    if (!edged_[e].is_followed) continue;
    for (size_t i = 0; i < cells; ++i) place_point(e, cells_seen_[e * cells + i].middle);
  }
  if (owners_.empty()) return;
  sample_points(job);
  shadows_.in_shares = true;
  shadows_.clear.resize(shadows_.weight.size());
  for (size_t i = 0; i < owners_.size(); ++i) shadows_.clear[i] = cells_seen_[owners_[i] * cells + i % cells].share;
  const LightEstimate light = estimate_of(job, int(cells));
  for (size_t begin = 0; begin < owners_.size(); begin += cells) {
    const EdgedShadingPoint& e = edged_[owners_[begin]];
    const PathVertex& v = vertex_of(job, e.shading_point);
    const auto by_simpson = [&](float LightMean::*value) {
      return (2.0f * e.by_middles.*value + e.by_corners.*value) / 3.0f;
    };
    // Simpson's rule does not hold across the horizon, which is no smooth change.
    const float scale = e.active == points ? by_simpson(&LightMean::weight) / e.by_middles.weight : 1.0f;
    job.arriving[lit_[places_part_.begin + e.shading_point]] +=
        reflected_light(shadows_, begin, int(cells), light, v) * scale;
    count_extrapolated(job, e.shading_point, e.fields, e.queried, e.exact);
    if (job.firsts.empty()) continue;
    float seen = 0.0f;
    for (size_t i = begin; i < begin + cells; ++i) seen += shadows_.clear[i] / float(cells);
    const float above = by_simpson(&LightMean::above), samples = float(job.light_samples);
    FirstHit& first = job.firsts[job.paths[v.path].slot];
    first.shadow_rays += above * samples;
    first.shadow_clear += std::min(seen, above) * samples;
    first.shadow_exact += std::min(float(e.exact), above * samples);
  }
}

}  // namespace fieldtrace
