#include "hybrid/shadow_answerer.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "field/bake.h"
#include "field/bake_coverage.h"
#include "field/cone.hd.h"
#include "field/query.hd.h"
#include "field/risk.h"

namespace fieldtrace {
namespace {

// How many rounds of baking one batch can need: the line's cell, the anchored cell, the re-anchored one, and the last
// two again from the other end of the segment. Cones need fewer: tiles, and two for sheets.
constexpr int k_most_bake_rounds = 6;

// world -> unit space of a ball in object space, composed in double.
void write_unit_transform(const Instance& instance, const Sphere& ball, float out[12]) {
  const double inverse_radius = 1.0 / double(ball.radius);
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      const double shift = column == 3 ? double(ball.centre[row]) : 0.0;
      out[column * 3 + row] = float((double(instance.to_object[column][row]) - shift) * inverse_radius);
    }
  }
}

// Bound on how much the linear part A lengthens a vector: the root of the largest eigenvalue of A^T A (Smith,
// "Eigenvalues of a symmetric 3 x 3 matrix", CACM 1961), and a thousandth for its rounding.
float stretch_bound(const float m[12]) {
  const auto column = [&](int i) { return DVec3(m[3 * i], m[3 * i + 1], m[3 * i + 2]); };
  const DVec3 diagonal(glm::dot(column(0), column(0)), glm::dot(column(1), column(1)), glm::dot(column(2), column(2)));
  const DVec3 beside(glm::dot(column(0), column(1)), glm::dot(column(1), column(2)), glm::dot(column(2), column(0)));
  const double mean = (diagonal.x + diagonal.y + diagonal.z) / 3.0;
  const DVec3 d = diagonal - DVec3(mean);
  const double p = std::sqrt((glm::dot(d, d) + 2.0 * glm::dot(beside, beside)) / 6.0);
  double largest = mean;
  if (p > 0.0) {
    const DVec3 b = d / p, c = beside / p;
    const double half_determinant =
        0.5 * (b.x * (b.y * b.z - c.y * c.y) - c.x * (c.x * b.z - c.y * c.z) + c.z * (c.x * c.y - b.y * c.z));
    largest = mean + 2.0 * p * std::cos(std::acos(std::clamp(half_determinant, -1.0, 1.0)) / 3.0);
  }
  return float(std::sqrt(largest) * (1.0 + 0x1p-10));
}

// Directions tried along each side of a light as seen from receivers on the object: so many that neighbours lie less
// than this share of a direction cell's mean width (2 sqrt(pi) / D) apart. A cell speaks for lines all over it, so
// closer directions find nothing more (docs/decisions/009-cones.md).
constexpr float k_sheet_spacing = 1.1f;
// More than any number of light samples: the light is too near or too wide.
constexpr int k_no_sheet_side = 1 << 12;

int sheet_side_for(const SegmentTask& ball, const Sphere& light, int directions) {
  const float* m = ball.to_unit;
  Vec3 centre(m[9], m[10], m[11]);
  for (int axis = 0; axis < 3; ++axis)
    centre += Vec3(m[3 * axis], m[3 * axis + 1], m[3 * axis + 2]) * light.centre[axis];
  // From the nearest point of the ball.
  const float sine = light.radius * ball.to_unit_stretch / (glm::length(centre) - 1.0f);
  if (!(sine > 0.0f && sine < scalar::k_widest_cone_sine)) return sine == 0.0f ? 1 : k_no_sheet_side;
  const float tangent = sine / std::sqrt(1.0f - sine * sine);
  const float cell = 2.0f * std::sqrt(k_pi) / float(directions);
  return std::max(1, int(std::ceil(2.0f * tangent / (k_sheet_spacing * cell))));
}

void sort_unique(std::vector<uint32_t>& list) {
  std::sort(list.begin(), list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

std::span<const uint32_t> as_indices(const AlignedVector<int32_t>& list, size_t count) {
  return {reinterpret_cast<const uint32_t*>(list.data()), count};
}

}  // namespace

struct ShadowAnswerer::Occluder {
  bool in_ball = false;        // culled by the field's ball, else by the bounding box
  bool answers_cones = false;  // of whole lights
  bool asks_sheets = true;     // depth cells may answer
  Field* field = nullptr;      // answers within the ball; null: exact rays
  ConeTask cone;               // for the ball
  BoxTask box;
};

struct ShadowAnswerer::Workspace {
  RayStates states;
  ExactLists exact;
  std::vector<uint32_t> indices;
  std::vector<uint8_t> exact_blocked;
  AlignedVector<int32_t> flags, refused;
  ConeUnknowns unknowns;
};

ShadowAnswerer::ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                               const std::vector<Field*>& fields, const AnswererSettings& settings)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(settings.isa)),
      settings_(settings),
      candidates_(scene),
      workspaces_([] { return std::make_unique<Workspace>(); }) {
  QueryPolicy policy;
  policy.visibility_max_class = policy.depth_max_class = settings.force_ask ? -1 : max_class_at(settings.tolerance);
  policy.answer_all = settings.tolerance >= 1.0f && !settings.force_ask;
  occluders_.resize(scene.instances.size());
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Shape& shape = scene.shapes[instance.shape];
    Occluder& o = occluders_[i];
    o.field = fields[instance.shape];
    o.in_ball = traits[instance.shape].wants_field;
    o.cone.segment.instance = o.box.instance = i;
    o.cone.segment.policy = policy;
    // Receivers on an object are answered by depth cells alone.
    o.asks_sheets = settings.own_to_rays.empty() || !settings.own_to_rays[instance.shape];
    if (!o.asks_sheets) o.cone.segment.policy.depth_max_class = -1;
    if (o.field) o.cone.segment.field = o.field->view();
    write_unit_transform(instance, field_ball(shape.bounds), o.cone.segment.to_unit);
    o.cone.segment.to_unit_stretch = stretch_bound(o.cone.segment.to_unit);
    const Sphere ball = field_ball(shape.bounds);
    for (int e = 0; e < 9; ++e) o.cone.from_unit[e] = instance.to_world[e / 3][e % 3] * ball.radius;
    for (int a = 0; a < 3; ++a) o.cone.half_extent[a] = 0.5f * shape.bounds.diagonal()[a] / ball.radius;
    o.answers_cones = o.field && settings.whole_lights && settings.tolerance > 0.0f && !settings.force_ask;
    o.cone.chord_share = settings.tolerance < k_estimating_tolerance ? 1.0f : scalar::k_chord_share;
    std::memcpy(o.box.to_object, &instance.to_object, sizeof o.box.to_object);
    o.box.to_object_stretch = stretch_bound(o.box.to_object);
    // The transform of a ray into object space rounds; the box grows by as much.
    const Vec3 extent = glm::max(glm::abs(shape.bounds.lower), glm::abs(shape.bounds.upper));
    const float slack = gamma_bound(8) * glm::length(extent);
    for (int axis = 0; axis < 3; ++axis) {
      o.box.lower[axis] = shape.bounds.lower[axis] - slack;
      o.box.upper[axis] = shape.bounds.upper[axis] + slack;
    }
    o.box.skip_own = traits[instance.shape].is_flat;
  }
}

ShadowAnswerer::~ShadowAnswerer() = default;

FieldUse& ShadowAnswerer::use_of(const Occluder& o, Stats& stats) const {
  stats.field_uses.resize(scene_.shapes.size());
  return stats.field_uses[scene_.instances[o.cone.segment.instance].shape];
}

void ShadowAnswerer::find_candidates(const ReceiverBatch& receivers, ShadowGroup& group, Stats& stats) const {
  Bounds3 bounds;
  for (size_t r = 0; r < receivers.size; ++r) {
    const float e = receivers.error[r];
    const Vec3 p(receivers.px[r], receivers.py[r], receivers.pz[r]);
    bounds.extend(p - Vec3(e));
    bounds.extend(p + Vec3(e));
  }
  candidates_.select(bounds, group.light, k_most_candidates, group.candidates);
  const bool test_each = group.light.kind == LightExtent::Kind::bounded && group.candidates.size() <= k_most_candidates;
  group.met.assign(padded(receivers.size), 0);
  const int32_t all = !group.candidates.empty() && !test_each ? k_may_shadow : 0;
  group.shadow.assign(padded(receivers.size), all);
  group.by_rays.assign(padded(receivers.size), all);
  group.by_leaves.assign(padded(receivers.size), 0);
  if (!test_each) return;
  Workspace& work = *workspaces_.local();
  Sphere light = group.light.ball;
  // The origin of a ray lies up to `error` beside the receiver.
  for (size_t r = 0; r < receivers.size; ++r) light.radius = std::max(light.radius, receivers.error[r]);
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const Occluder& o = occluders_[group.candidates[slot]];
    work.flags.assign(padded(receivers.size), 0);
    if (o.in_ball) {
      kernels_.hull_meets_ball(o.cone.segment, receivers, light, work.flags.data());
    } else {
      kernels_.hull_meets_box(o.box, receivers, light, work.flags.data());
    }
    std::fill(work.flags.begin() + std::ptrdiff_t(receivers.size), work.flags.end(), 0);
    for (size_t r = 0; r < work.flags.size(); ++r) {
      group.met[r] |= work.flags[r];
      if (group.shadow[r] & k_light_blocked) work.flags[r] = 0;  // nothing more to learn
    }
    if (o.answers_cones && group.light_samples >= k_fewest_cone_samples) {
      const auto own_open = [&] {
        uint64_t n = 0;
        for (size_t r = 0; r < receivers.size; ++r) {
          n += receivers.instance[r] == group.candidates[slot] && work.flags[r] == k_may_shadow;
        }
        return n;
      };
      const uint64_t before = settings_.count_uses ? own_open() : 0;
      ask_cones(o, receivers, group, work, stats);
      if (settings_.count_uses) use_of(o, stats).own_answered += (before - own_open()) * uint64_t(group.light_samples);
    }
    for (size_t r = 0; r < work.flags.size(); ++r) {
      const int32_t flag = work.flags[r];
      group.shadow[r] |= flag & ~k_by_leaves;
      group.by_leaves[r] |= flag & k_by_leaves ? 1 << slot : 0;
      group.by_rays[r] |= (flag & (k_may_shadow | k_by_leaves)) == k_may_shadow;
    }
  }
  const auto is_spared = [&](size_t r) {
    return group.met[r] && (!group.shadow[r] || group.shadow[r] & k_light_blocked);
  };
  for (size_t r = 0; r < receivers.size; ++r) stats.samples_spared += is_spared(r) ? uint64_t(group.light_samples) : 0;
}

void ShadowAnswerer::ask_cones(const Occluder& o, const ReceiverBatch& receivers, const ShadowGroup& group,
                               Workspace& work, Stats& stats) const {
  ConeTask task = o.cone;
  const Sphere& light = group.light.ball;
  const int side = sheet_side_for(task.segment, light, o.field->parameters().directions);
  if (o.asks_sheets && side * side <= group.light_samples) task.sheet_side = side;
  ConeUnknowns& unknowns = work.unknowns;
  bake_and_repeat(o, receivers.size, unknowns, stats, [&](std::span<const uint32_t> blocks) {
    const ConeCounts counts = kernels_.light_cones(task, receivers, light, blocks, work.flags.data(), unknowns);
    stats.cones_clear += counts.clear;
    stats.cones_blocked += counts.blocked;
    stats.lookups += counts.lookups;
    if (settings_.count_uses) {
      use_of(o, stats).answered += (counts.clear + counts.blocked) * uint64_t(group.light_samples);
    }
  });
}

// Calls ask(blocks) for all blocks of k_batch_padding among `size` entries, bakes what it reports in `unknowns`, and
// calls it again for the blocks that met it. Blocks that are still unknown in the end are left in `unknowns`.
template <class Ask>
void ShadowAnswerer::bake_and_repeat(const Occluder& o, size_t size, ConeUnknowns& unknowns, Stats& stats,
                                     const Ask& ask) const {
  const uint32_t shape = scene_.instances[o.cone.segment.instance].shape;
  unknowns.tiles.clear();
  unknowns.slices.clear();
  unknowns.blocks.clear();
  for (size_t i = 0; i < size; i += k_batch_padding) unknowns.blocks.push_back(uint32_t(i));
  std::vector<uint32_t> blocks;
  bool is_full = false;
  for (int round = 0; !unknowns.blocks.empty() && !is_full && round <= k_most_bake_rounds; ++round) {
    blocks.swap(unknowns.blocks);
    unknowns.blocks.clear();
    ask(blocks);
    if (unknowns.blocks.empty()) break;
    is_full = o.field->pool_full() || o.field->coverage().full();  // the rest is left to single rays
    BakeCounters counters;
    sort_unique(unknowns.tiles);
    sort_unique(unknowns.slices);
    if (!unknowns.tiles.empty()) bake_coverage(*o.field, unknowns.tiles, accel_, shape, counters);
    if (!unknowns.slices.empty()) bake_slices(*o.field, FieldLayer::depth, unknowns.slices, accel_, shape, counters);
    unknowns.tiles.clear();
    unknowns.slices.clear();
    stats.bake_rays += counters.rays;
    stats.time_bake += counters.seconds;
  }
}

void ShadowAnswerer::filter(const ShadowGroup& group, std::span<const uint32_t> receivers, int leaves,
                            ShadowBatch& batch, std::vector<uint8_t>& refused, Stats& stats) const {
  Workspace& work = *workspaces_.local();
  batch.in_shares = true;
  batch.clear.assign(padded(batch.rays.size), 1.0f);
  work.refused.assign(padded(batch.rays.size), 0);
  ConeUnknowns& unknowns = work.unknowns;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const Occluder& o = occluders_[group.candidates[slot]];
    if (!o.answers_cones) continue;
    work.flags.assign(padded(batch.rays.size), 0);
    bool is_asked = false;
    for (size_t r = 0; r < receivers.size(); ++r) {
      if (!(group.by_leaves[receivers[r]] >> slot & 1)) continue;
      is_asked = true;
      std::fill_n(work.flags.begin() + std::ptrdiff_t(r * size_t(leaves)), leaves, 1);
    }
    if (!is_asked) continue;
    LeafTask task;
    task.segment = o.cone.segment;
    task.least_disc = k_least_light_disc / std::sqrt(float(std::max(leaves, k_fewest_leaves)));
    task.share = 1.0f / float(std::max(leaves, k_fewest_leaves));
    bake_and_repeat(o, batch.rays.size, unknowns, stats, [&](std::span<const uint32_t> blocks) {
      stats.lookups += kernels_.filter_leaves(task, batch.rays, batch.pdf.data(), work.flags.data(), blocks,
                                              batch.clear.data(), work.refused.data(), unknowns);
    });
    // What no pool has room for is left to rays.
    for (const uint32_t block : unknowns.blocks) std::fill_n(work.refused.begin() + block, k_batch_padding, 1);
  }
  refused.assign(receivers.size(), 0);
  for (size_t r = 0; r < receivers.size(); ++r) {
    const auto begin = work.refused.begin() + std::ptrdiff_t(r * size_t(leaves));
    refused[r] = std::find(begin, begin + leaves, 1) != begin + leaves;
  }
}

void ShadowAnswerer::count_filtered(const ShadowGroup& group, uint32_t receiver, Stats& stats) const {
  if (!settings_.count_uses) return;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    if (!(group.by_leaves[receiver] >> slot & 1)) continue;
    use_of(occluders_[group.candidates[slot]], stats).answered += uint64_t(group.light_samples);
  }
}

bool ShadowAnswerer::extrapolates(const ShadowGroup& group) const {
  if (settings_.tolerance < k_estimating_tolerance || group.candidates.size() > k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(),
                     [this](uint32_t candidate) { return occluders_[candidate].answers_cones; });
}

bool ShadowAnswerer::gains_by_halving(const ShadowGroup& group) const {
  // Where every cell asks, the groups are those of Monte Carlo, so that both trace the same rays.
  if (settings_.force_ask || group.candidates.size() <= k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(),
                     [this](uint32_t candidate) { return occluders_[candidate].field != nullptr; });
}

void ShadowAnswerer::bake_unknown(const Occluder& o, int32_t slot, const ShadowBatch& batch, Workspace& work,
                                  Stats& stats) const {
  const uint32_t shape = scene_.instances[o.cone.segment.instance].shape;
  RayStates& states = work.states;
  SegmentTask task = o.cone.segment;
  for (int round = 0; !states.unknown_blocks.empty(); ++round) {
    BakeCounters counters;
    const auto bake = [&](FieldLayer layer, std::vector<uint32_t>& slices) {
      sort_unique(slices);
      bake_slices(*o.field, layer, slices, accel_, shape, counters);
      slices.clear();
    };
    bake(FieldLayer::visibility, states.unknown_visibility);
    bake(FieldLayer::depth, states.unknown_depth);
    stats.bake_rays += counters.rays;
    stats.time_bake += counters.seconds;
    std::vector<uint32_t> blocks;
    blocks.swap(states.unknown_blocks);
    const bool give_up = o.field->pool_full() || round >= k_most_bake_rounds;
    for (const uint32_t begin : blocks) {
      const size_t end = begin + k_batch_padding;
      // No room to bake: all rays of such a block are traced.
      const SegmentCounts again =
          give_up ? kernels_.cross_ball(task, batch.rays, begin, end, slot, states)
                  : kernels_.query(task, batch.rays, batch.instance.data(), begin, end, slot, states);
      stats.lookups += again.lookups;
      stats.sphere_crossings += again.crossings;
    }
  }
}

void ShadowAnswerer::check_whole(const ShadowGroup& group, bool blocked, const ShadowBatch& batch, Stats& stats) const {
  Workspace& work = *workspaces_.local();
  std::vector<uint8_t> hidden(batch.rays.size, 0), asked(batch.rays.size, 0);
  for (const uint32_t candidate : group.candidates) {
    const Occluder& o = occluders_[candidate];
    if (!o.answers_cones) continue;
    work.states.keep_verdicts = false;
    work.states.reset(batch.rays.size);
    kernels_.cross_ball(o.cone.segment, batch.rays, 0, padded(batch.rays.size), 0, work.states);
    work.indices.clear();
    for (uint32_t i = 0; i < batch.rays.size; ++i) {
      if (work.states.state[i] & RayStates::k_crosses) work.indices.push_back(i);
    }
    for (const uint32_t i : work.indices) asked[i] = 1;
    accel_.occluded_by(candidate, batch.rays, work.indices, hidden.data());
  }
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (!asked[i]) continue;
    const bool wrong = blocked != (hidden[i] != 0);
    const bool own = occluders_[batch.instance[i]].answers_cones;
    stats.add_check(blocked, own, wrong);
  }
}

void ShadowAnswerer::check_answers(const Occluder& o, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const auto& verdict = work.states.verdict;
  work.indices.clear();
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (verdict[i] == scalar::k_verdict_clear || verdict[i] == scalar::k_verdict_blocked) {
      work.indices.push_back(uint32_t(i));
    }
  }
  work.exact_blocked.assign(batch.rays.size, 0);
  accel_.occluded_by(o.cone.segment.instance, batch.rays, work.indices, work.exact_blocked.data());
  for (const uint32_t i : work.indices) {
    const bool blocked = verdict[i] == scalar::k_verdict_blocked;
    const bool own = batch.instance[i] == o.cone.segment.instance;
    const bool wrong = blocked != (work.exact_blocked[i] != 0);
    stats.add_check(blocked, own, wrong);
  }
}

void ShadowAnswerer::count_uses(const Occluder& o, const ShadowBatch& batch, const Workspace& work,
                                Stats& stats) const {
  FieldUse& use = use_of(o, stats);
  for (size_t i = 0; i < batch.rays.size; ++i) {
    const int32_t verdict = work.states.verdict[i];
    const bool own = batch.instance[i] == o.cone.segment.instance;
    const bool asked = verdict == scalar::k_verdict_ask;
    const bool answered = verdict == scalar::k_verdict_clear || verdict == scalar::k_verdict_blocked;
    use.asked += asked;
    use.answered += answered;
    use.own_asked += own && asked;
    use.own_answered += own && answered;
  }
}

void ShadowAnswerer::classify(const ShadowGroup& group, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const size_t n = padded(batch.rays.size);
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const Occluder& o = occluders_[group.candidates[slot]];
    SegmentCounts counts;
    if (!o.in_ball) {
      counts = kernels_.cross_box(o.box, batch.rays, batch.instance.data(), 0, n, int32_t(slot), work.states);
    } else if (!o.field) {
      counts = kernels_.cross_ball(o.cone.segment, batch.rays, 0, n, int32_t(slot), work.states);
    } else {
      counts = kernels_.query(o.cone.segment, batch.rays, batch.instance.data(), 0, n, int32_t(slot), work.states);
      bake_unknown(o, int32_t(slot), batch, work, stats);
      if (settings_.check) check_answers(o, batch, work, stats);
      if (settings_.count_uses) count_uses(o, batch, work, stats);
    }
    stats.sphere_crossings += counts.crossings;
    stats.lookups += counts.lookups;
  }
}

void ShadowAnswerer::trace(const ShadowGroup& group, ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const auto one = as_indices(work.exact.one_asker, work.exact.one_count);
  const auto many = as_indices(work.exact.many_askers, work.exact.many_count);
  stats.rays_exact += one.size() + many.size();
  for (const uint32_t i : one) batch.exact[i] = 1;
  for (const uint32_t i : many) batch.exact[i] = 1;
  accel_.occluded(batch.rays, many, batch.blocked.data());
  if (group.candidates.size() == 1) {
    accel_.occluded_by(group.candidates[0], batch.rays, one, batch.blocked.data());
    return;
  }
  if (one.empty()) return;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    work.indices.clear();
    for (const uint32_t i : one) {
      if (work.states.asker[i] == int32_t(slot)) work.indices.push_back(i);
    }
    if (!work.indices.empty())
      accel_.occluded_by(group.candidates[slot], batch.rays, work.indices, batch.blocked.data());
  }
}

void ShadowAnswerer::trace_all(ShadowBatch& batch, Workspace& work, Stats& stats) const {
  work.indices.clear();
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (batch.rays.tmax[i] < 0.0f) continue;
    work.indices.push_back(uint32_t(i));
    batch.exact[i] = 1;
  }
  stats.rays_crossing += work.indices.size();
  stats.sphere_crossings += work.indices.size();
  stats.rays_exact += work.indices.size();
  stats.rays_crowded += work.indices.size();
  accel_.occluded(batch.rays, work.indices, batch.blocked.data());
}

void ShadowAnswerer::answer(const ShadowGroup& group, ShadowBatch& batch, Stats& stats) const {
  if (group.candidates.empty()) return;
  Workspace& work = *workspaces_.local();
  if (group.candidates.size() > k_most_candidates) {
    trace_all(batch, work, stats);
    return;
  }
  work.states.keep_verdicts = settings_.check || settings_.count_uses;
  work.states.reset(batch.rays.size);
  classify(group, batch, work, stats);
  kernels_.collect(work.states, batch.rays.size, batch.blocked.data(), work.exact);
  stats.rays_crossing += work.exact.crossing;
  trace(group, batch, work, stats);
}

}  // namespace fieldtrace
