// Answers shadow rays for a scene: candidate culling, field look-ups where a candidate has a field, exact rays for the
// rest.
//
// Monte Carlo is the same code with no fields: it gets the same culling and the same packets. A ray that only one
// candidate asks for is traced against that candidate alone, others against the whole scene; a batch with more
// candidates than k_most_candidates goes to the whole scene without culling. Thread-safety: answer() may be called from
// any number of threads; fields grow by demand meanwhile. Determinism: a ray's answer depends on nothing but the ray,
// its batch's receivers and light, and the objects.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <memory>
#include <vector>

#include "core/accel.h"
#include "field/field.h"
#include "field/segment_kernels.h"
#include "hybrid/shadow_answer.h"
#include "hybrid/shadow_candidates.h"

namespace fieldtrace {

struct AnswererSettings {
  Isa isa = Isa::scalar;  // resolved
  float tolerance = 0.1f;
  bool check = false;      // trace an exact ray beside every certified answer
  bool force_ask = false;  // look up, then ask all the same
};

// Objects with fewer triangles are left to exact rays, which cost little more than a look-up there.
inline constexpr size_t k_fewest_field_triangles = 256;

// Whether all of a shape lies in one plane: such a shape cannot block rays that leave it, and gets no field.
bool is_flat(const Shape& shape);
// Whether a shape is worth a field at all.
bool wants_field(const Shape& shape);

class SceneAnswerer final : public ShadowAnswerer {
 public:
  // fields[s] is the field of shape s, or null: then its instances are answered by exact rays. All must outlive this.
  SceneAnswerer(const Scene& scene, const Accel& accel, std::vector<Field*> fields, const AnswererSettings& settings);
  ~SceneAnswerer() override;

  void answer(const ShadowQuery& query, Stats& stats) const override;

 private:
  struct Occluder;
  struct Workspace;

  void classify(const Occluder& occluder, const ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void bake_unknown(const Occluder& occluder, const ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void check_answers(const Occluder& occluder, const ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void trace(ShadowBatch& batch, Workspace& work, Stats& stats) const;

  const Scene& scene_;
  const Accel& accel_;
  const SegmentKernels& kernels_;
  AnswererSettings settings_;
  ShadowCandidates candidates_;
  std::vector<Field*> fields_;
  std::vector<Occluder> occluders_;  // one per instance
  mutable tbb::enumerable_thread_specific<Workspace> workspaces_;
};

}  // namespace fieldtrace
