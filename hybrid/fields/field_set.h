// The fields of one render, one per shape that wants one, their cache, and the fallback when they outgrow their memory.
//
// All fields of a render share one budget (field/store/field_budget.h). A render that exceeds it restarts with less:
//   1. without the fields read from a cache, if there were any;
//   2. without certified hits for glossy rays, if any were planned;
//   3. with D and N halved, repeatedly, down to 32 x 64;
//   4. with fields for so few shapes that complete ones fit, those with the most triangles times instances; the others
//      are left to exact rays.
// Every step follows from constants, the scene and the budget, and what an attempt needs follows from what the picture
// demands: no query demands a cell before those that may make it needless are known
// (tests/hybrid/field_demand_test.cpp). So the picture does not depend on threads, tiles or the state of a cache even
// where memory runs out. Where the system limits address space (core/platform/address_space.h), that bounds the fields'
// pools too, and a full pool takes the same steps. Thread-safety: a FieldSet is used by one thread; its fields by any
// number.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "field/file/field_cache.h"
#include "field/file/keep.h"
#include "field/store/field.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// What one attempt at a render may use.
struct FieldPlan {
  FieldParameters parameters;
  size_t most_fields = std::numeric_limits<size_t>::max();
  bool read_cache = true;
  uint32_t reductions = 0;  // by how many steps the picture has less than was asked for
  // Light samples of the whole picture, over all lights. A shape whose bake they would not pay is left to exact rays.
  // Infinite: no shape is; 0: all are.
  double light_samples = std::numeric_limits<double>::infinity();
  std::vector<uint32_t> hit_instances;  // their shapes get fields for glossy rays even where shadow rays gain nothing
};

// Answers of a field that pay for one ray of its bake: that ray takes one to two times as long as a shadow ray, and an
// answer spares half of one (docs/decisions/050-light-samples-by-cost.md).
inline constexpr double k_answers_a_bake_ray = 2.0;

// Light samples of a pixel, over its camera samples, below which rays take less than look-ups and what they rest on:
// surveys, and reading or baking fields (docs/decisions/051-blocks-of-pixels.md).
inline constexpr int64_t k_fewest_field_samples = 64;

// Whether more than k_most_undecided of the surveyed rays of shading points on the object itself are undecided.
bool is_undecided_of_itself(const FieldUse& use);

// Counts of a survey of the picture (hybrid/render/field_survey.h), which decide what is left to exact rays.
struct FieldSurvey {
  std::vector<FieldUse> uses;  // per shape of the scene
  double scale = 1.0;          // camera samples of the picture for each surveyed one
  Stats stats;                 // of the survey's own rays
  bool interrupted = false;  // by `stop`; the counts are then meaningless
};

// The default budget: half of the machine's memory.
uint64_t default_field_memory();

class FieldSet {
 public:
  // Makes empty fields for the shapes of `scene` that want one, as many as the plan allows; none unless `wanted`. They
  // share `address_space` bytes evenly; if that does not hold even their tables, the budget counts as exceeded from the
  // start.
  FieldSet(const Scene& scene, std::span<const ShapeTraits> traits, const FieldPlan& plan, uint64_t budget_bytes,
           bool wanted, uint64_t address_space = k_no_address_limit);

  bool empty() const { return count_ == 0; }
  std::vector<Field*> pointers() const;      // by shape, for shadow rays; null: exact rays
  std::vector<Field*> all_pointers() const;  // by shape, including those for glossy rays only; null: none
  // By shape: not 0 where rays from the object itself do not use its field.
  const std::vector<uint8_t>& self_to_rays() const { return self_to_rays_; }
  bool answers_shadows() const;  // whether pointers() has any
  // Leaves all objects to exact rays, unless cost does not decide.
  void leave_all();
  // Leaves objects to exact rays whose bake would not be paid by all the light samples that a survey without fields
  // counts past them; and shadows on themselves where their cells would not.
  void leave_unpaid(const FieldSurvey& survey);
  // Leaves shadows on themselves to exact rays where a survey finds that fields leave too much of them undecided.
  void leave_undecided(const FieldSurvey& survey);
  const FieldBudget& budget() const { return *budget_; }

  // Reads fields from the cache, if the plan allows it.
  void load(FieldCache& cache);
  // Keeps fields in the cache of which enough was baked since; all, where it is an error if they are not kept.
  void store(FieldCache& cache, IfUnkept if_unkept, const WarningSink& warning, Stats& stats) const;
  void count(Stats& stats) const;

  // The plan of the next attempt, after one that exceeded the budget. `change` receives what is different, for a
  // warning.
  FieldPlan next_plan(std::string& change) const;

 private:
  void leave(size_t shape);
  bool cost_decides() const { return plan_.light_samples < std::numeric_limits<double>::infinity(); }
  // Estimated rays to bake what a shape needs. Coverage maps take one line a texel, and few cells are baked beside
  // them; but lights all around and at infinity are asked about by single rays, which want cells.
  double needed_rays(size_t shape) const;
  // Answers that pay for it, and for the cells alone that its shadows on itself take.
  double needed_answers(size_t shape) const { return k_answers_a_bake_ray * needed_rays(shape); }
  double needed_self_answers(size_t shape) const { return k_answers_a_bake_ray * bake_rays_[shape]; }

  const Scene& scene_;
  FieldPlan plan_;
  uint64_t address_space_;
  std::unique_ptr<FieldBudget> budget_;  // outlives the fields
  std::vector<std::unique_ptr<Field>> fields_;
  std::vector<double> bake_rays_;  // by shape: estimated
  std::vector<uint64_t> loaded_;   // by shape: rays of what the cache held
  // By shape: shadow rays do not use its field at all, or not from the object itself; glossy rays use it.
  std::vector<uint8_t> left_to_rays_, self_to_rays_, for_hits_;
  size_t count_ = 0;
  bool has_loaded_ = false;
};

}  // namespace fieldtrace
