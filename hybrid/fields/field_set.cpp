#include "hybrid/fields/field_set.h"

#include <algorithm>
#include <atomic>
#include <numeric>

#include "core/platform/machine_memory.h"
#include "core/platform/parallel.h"
#include "hybrid/fields/bake_estimate.h"

namespace fieldtrace {
namespace {

constexpr int k_fewest_directions = 32, k_fewest_plane = 64;

// Shading points on an object are left to exact rays if its field leaves more than this share of their rays undecided:
// what it answers of the rest is wrong more often than elsewhere (docs/decisions/012-left-to-rays.md).
constexpr double k_most_undecided = 0.75;

// New rays of a field's bake for which its file is written again: so many, or this part of what the file holds. The
// next frame of a moving camera asks for a little more each time, and writing takes longer than that bake
// (docs/decisions/050-light-samples-by-cost.md).
constexpr uint64_t k_many_new_rays = 250'000;
constexpr double k_least_growth = 1.0 / 16.0;

uint64_t bake_rays_of(const Field& field) {
  const uint64_t of_cell = uint64_t(field.parameters().lines) + 1;
  return field.cells_baked() * of_cell + field.primitives_baked() + field.coverage().lines_baked();
}

// Where `kept` of a field's `rays` lie in its file.
bool has_grown(uint64_t rays, uint64_t kept) {
  return double(rays - kept) >= std::min(k_least_growth * double(kept), double(k_many_new_rays));
}

// Shapes that want a field, by decreasing gain: the order in which they get one.
std::vector<uint32_t> shapes_by_gain(const Scene& scene, std::span<const ShapeTraits> traits) {
  std::vector<uint64_t> gain(scene.shapes.size(), 0);
  for (const Instance& instance : scene.instances)
    gain[instance.shape] += scene.shapes[instance.shape].triangle_count();
  std::vector<uint32_t> order(scene.shapes.size());
  std::iota(order.begin(), order.end(), 0u);
  std::erase_if(order, [&](uint32_t s) { return !traits[s].wants_field; });
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return gain[a] > gain[b]; });
  return order;
}

}  // namespace

bool is_undecided_of_itself(const FieldUse& use) {
  const double answered = double(use.self_answered), undecided = double(use.self_undecided);
  return undecided > k_most_undecided * (answered + undecided);
}

uint64_t default_field_memory() { return machine_memory_bytes() / 2; }

FieldSet::FieldSet(const Scene& scene, std::span<const ShapeTraits> traits, const FieldPlan& plan,
                   uint64_t budget_bytes, bool wanted, uint64_t address_space)
    : scene_(scene),
      plan_(plan),
      address_space_(address_space),
      budget_(std::make_unique<FieldBudget>(budget_bytes)),
      fields_(scene.shapes.size()),
      loaded_(scene.shapes.size(), 0),
      left_to_rays_(scene.shapes.size(), 0),
      self_to_rays_(scene.shapes.size(), 0),
      for_hits_(scene.shapes.size(), 0) {
  if (!wanted) return;
  bake_rays_ = estimated_bake_rays(scene, plan.parameters);
  for (const uint32_t i : plan.hit_instances) for_hits_[scene.instances[i].shape] = 1;
  std::vector<uint32_t> chosen;
  for (const uint32_t s : shapes_by_gain(scene, traits)) {
    if (chosen.size() == plan.most_fields) break;
    if (needed_answers(s) > plan.light_samples) {
      left_to_rays_[s] = 1;
      if (!for_hits_[s]) continue;
    }
    chosen.push_back(s);
  }
  count_ = chosen.size();
  const uint64_t share =
      address_space == k_no_address_limit ? address_space : address_space / std::max(count_, size_t(1));
  if (count_ > 0 && Field::table_bytes(plan.parameters) > share / 2) {
    budget_->refuse_addresses();
    return;
  }
  for (const uint32_t s : chosen)
    fields_[s] = std::make_unique<Field>(field_ball(scene.shapes[s].bounds), plan.parameters, budget_.get(), share);
}

std::vector<Field*> FieldSet::pointers() const {
  std::vector<Field*> pointers;
  for (size_t s = 0; s < fields_.size(); ++s) pointers.push_back(left_to_rays_[s] ? nullptr : fields_[s].get());
  return pointers;
}

double FieldSet::needed_rays(size_t shape) const {
  const bool by_maps = std::all_of(scene_.emitters.begin(), scene_.emitters.end(), [](const Emitter& e) {
    return e.kind == EmitterKind::area || e.kind == EmitterKind::point;
  });
  return by_maps ? bake_rays_[shape] * coverage_share(plan_.parameters) : bake_rays_[shape];
}

std::vector<Field*> FieldSet::all_pointers() const {
  std::vector<Field*> pointers;
  for (const auto& field : fields_) pointers.push_back(field.get());
  return pointers;
}

bool FieldSet::answers_shadows() const {
  for (size_t s = 0; s < fields_.size(); ++s) {
    if (fields_[s] && !left_to_rays_[s]) return true;
  }
  return false;
}

void FieldSet::leave(size_t shape) {
  left_to_rays_[shape] = 1;
  if (for_hits_[shape]) return;
  fields_[shape].reset();
  --count_;
}

void FieldSet::leave_all() {
  if (!cost_decides()) return;
  for (size_t s = 0; s < fields_.size(); ++s) {
    if (fields_[s] && !left_to_rays_[s]) leave(s);
  }
}

void FieldSet::leave_unpaid(const FieldSurvey& survey) {
  if (!cost_decides()) return;
  for (size_t s = 0; s < fields_.size(); ++s) {
    if (!fields_[s] || left_to_rays_[s]) continue;
    self_to_rays_[s] = double(survey.uses[s].self_met) * survey.scale < needed_self_answers(s);
    if (double(survey.uses[s].met) * survey.scale < needed_answers(s)) leave(s);
  }
}

void FieldSet::leave_undecided(const FieldSurvey& survey) {
  for (size_t s = 0; s < fields_.size(); ++s) {
    if (fields_[s] && !left_to_rays_[s] && is_undecided_of_itself(survey.uses[s])) self_to_rays_[s] = 1;
  }
}

void FieldSet::load(FieldCache& cache) {
  if (!plan_.read_cache) return;
  std::atomic<bool> has_loaded = has_loaded_;
  parallel_for(fields_.size(), [&](size_t s) {
    if (!fields_[s] || budget_->exceeded()) return;
    if (!cache.load(*fields_[s], field_identity(scene_.shapes[s], plan_.parameters))) return;
    loaded_[s] = bake_rays_of(*fields_[s]);
    has_loaded = true;
  });
  has_loaded_ = has_loaded;
}

// Sequentially, because storing a field holds a second copy of it.
void FieldSet::store(FieldCache& cache, IfUnkept if_unkept, const WarningSink& warning, Stats& stats) const {
  for (size_t s = 0; s < fields_.size(); ++s) {
    if (!fields_[s]) continue;
    const FieldIdentity identity = field_identity(scene_.shapes[s], plan_.parameters);
    const bool is_new = has_grown(bake_rays_of(*fields_[s]), loaded_[s]) || cache.bytes_on_disk(identity) == 0;
    if (is_new || if_unkept == IfUnkept::fail)
      keep("the field of " + scene_.shapes[s].name, if_unkept, warning, [&] { cache.store(*fields_[s], identity); });
    else
      cache.mark_used(identity);
    stats.field_bytes_disk += cache.bytes_on_disk(identity);
  }
}

void FieldSet::count(Stats& stats) const {
  for (size_t s = 0; s < fields_.size(); ++s) {
    const auto& field = fields_[s];
    stats.field_left_to_rays += left_to_rays_[s];
    if (!field) continue;
    stats.field_objects += !left_to_rays_[s] || for_hits_[s];
    stats.field_self_to_rays += !left_to_rays_[s] && self_to_rays_[s];
    stats.field_cells_baked += field->cells_baked();
    stats.field_cells_full += field->cells_full();
    stats.field_bytes_memory += field->bytes();
    stats.field_tiles_baked += field->coverage().tiles_baked();
    stats.field_directions = plan_.parameters.directions;
    stats.field_plane = plan_.parameters.plane;
  }
}

FieldPlan FieldSet::next_plan(std::string& change) const {
  FieldPlan next = plan_;
  if (has_loaded_) {
    next.read_cache = false;
    change = "begins again without what the cache holds";
    return next;
  }
  next.read_cache = true;
  ++next.reductions;
  if (!next.hit_instances.empty()) {
    next.hit_instances.clear();
    change = "begins again with exact rays for what glossy rays meet";
    return next;
  }
  FieldParameters& p = next.parameters;
  if (p.directions > k_fewest_directions || p.plane > k_fewest_plane) {
    p.directions = std::max(p.directions / 2, k_fewest_directions);
    p.plane = std::max(p.plane / 2, k_fewest_plane);
    change = "begins again with fields of " + std::to_string(p.directions) + " x " + std::to_string(p.plane) + " cells";
    return next;
  }
  // Complete fields of so many shapes fit, so this is the last attempt.
  next.most_fields =
      size_t(std::min(budget_->limit() / Field::most_bytes(p), address_space_ / Field::reserved_bytes(p)));
  change = "begins again with fields for " + std::to_string(next.most_fields) + " of " + std::to_string(count_) +
           " objects, and exact rays for the others";
  return next;
}

}  // namespace fieldtrace
