// Answers shadow rays: candidate culling, field look-ups where a candidate has a field, exact rays for the rest. The
// one place where Monte Carlo and the hybrid method differ: Monte Carlo is the same code with no fields, so that it
// gets the same culling and the same packets.
//
// Two steps. find_candidates() names the objects that may stand between a group of shading points and a light, and the
// shading points that any of them may shadow; the others need no shadow rays. answer() then decides every ray of the
// shading points that are left. A ray that only one candidate asks for is traced against that candidate alone, others
// against the whole scene; a group with more candidates than k_most_candidates goes to the whole scene without further
// culling.
//
// Its parts: shadow_answerer.cpp culls; shadow_answerer_lights.cpp asks fields for whole lights and parts of them,
// shadow_answerer_rays.cpp for single rays, and traces the rest; shadow_answerer_checks.cpp counts beside them.
// Thread-safety: const functions may be called from any number of threads; fields grow by demand meanwhile.
// Determinism: a ray's answer depends on nothing but the ray, its group's shading points and light, and the objects.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <memory>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "field/thesis/thesis_field.h"
#include "field/thesis/thesis_kernels.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/shadow_candidates.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

struct AnswererSettings {
  Isa isa = Isa::scalar;         // resolved
  float tolerance = 0.1f;        // [0, 1]
  bool check = false;            // trace an exact ray beside every certified answer
  bool force_undecided = false;  // look up, then ask all the same
  bool whole_lights = true;      // ask for whole lights before single rays, where a tolerance allows it
  bool count_uses = false;       // fill Stats::field_uses
  // Trace every shadow ray against the whole scene: then a shading point's light depends in no way on its group, which
  // decides otherwise whether its light is sampled or, where nothing can stand before it, known in closed form.
  bool whole_scene = false;
  // Per shape: its shading points are not answered by its own field. Empty: none.
  std::vector<uint8_t> self_to_rays = {};
};

// Beyond this many candidates for one group, one traversal of the whole scene costs less than their tests
// (docs/decisions/010-overflow.md).
inline constexpr size_t k_most_candidates = 16;

// With fewer light samples a shading point, looking up its single rays costs no more than asking about the whole light.
inline constexpr int k_fewest_cone_samples = 4;

// Strata of a light are no wider than a light cut into this many parts, with fewer samples too: wider ones blur.
inline constexpr int k_fewest_strata = 16;

// Half width, in texels, of a light's disc at the blocker below which its strata are refused: contact shadows, which
// single rays answer better (docs/decisions/014-strata.md).
inline constexpr float k_least_light_disc = 2.0f;

// A wider light, in direction cells, is seen through so many cells that their mistakes do not gather.
inline constexpr float k_cells_across = 3.0f;

// From this tolerance on (the default) answers are estimates where that saves much: cones look for surfaces in the
// middle half of a chord only, and a few points of a light may stand for all. Below, only what cells certify is
// answered.
inline constexpr float k_estimating_tolerance = 0.1f;

// The light that a group asks for, and what find_candidates() found. Kept by the caller between the two steps.
struct ShadowGroup {
  LightExtent light;
  std::vector<uint32_t> candidates;  // instances; more than k_most_candidates: too many to test one by one
  int light_samples = 1;             // that each shading point would send
  AlignedVector<int32_t> met;        // per shading point: not 0 if its cone meets some candidate's bounds
  AlignedVector<int32_t> shadow;     // per shading point: k_may_shadow, k_light_blocked; 0: nothing stands between
  // Per shading point that may be shadowed: the candidates, as bits, that may be asked about parts of the light; and
  // whether others must be asked ray by ray.
  AlignedVector<int32_t> by_strata, by_rays;
  // With --check, per shading point whose light is blocked: the instance whose field said so.
  std::vector<uint32_t> blocked_by;
};

// What is known of how much of the light the shading points see whose rays are asked about.
enum class LightSeen { unknown, in_part };

struct ShadowInstance;  // hybrid/visibility/shadow_instance.h

class ShadowAnswerer {
 public:
  // traits[s] are those of shape s. fields[s] is its field, or null: then its instances are answered by exact rays. Of
  // thesis_fields, by the thesis' chart, a shape may have one instead, which answers every single ray that meets it,
  // whatever the tolerance; empty: none. The scene, `accel` and the fields must outlive this.
  ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                 const std::vector<Field*>& fields, const AnswererSettings& settings,
                 const std::vector<const ThesisField*>& thesis_fields = {});
  ~ShadowAnswerer();

  // Fills `group` for the shading points' positions, geometric normals, errors and instances; group.light and
  // light_samples are set by the caller. With fields, whole lights are answered where that is certain: such shading
  // points need no rays.
  void find_candidates(const ShadingPointBatch& shading_points, ShadowGroup& group, Stats& stats) const;

  // Whether agreement of a light's probe rays may stand for all of it: where some candidate of the group answers
  // by a field, at a tolerance from which on all answers are estimates.
  bool extrapolates(const ShadowGroup& group) const;
  // Whether answer() believes some candidate's depth cells less for what is seen of the light.
  bool doubts_depth(const ShadowGroup& group, LightSeen seen) const;
  bool checks() const { return settings_.check; }
  // For strata of a light, `leaves` for each of `shading points` (indices into the group's; by_rays must be 0) as
  // sample_light() laid them out in `batch`: sets batch.clear. refused[i] is set to 1 for shading points that some
  // field cannot tell about; their shares are then of no use.
  void filter(const ShadowGroup& group, std::span<const uint32_t> shading_points, int strata, ShadowBatch& batch,
              std::vector<uint8_t>& refused, Stats& stats) const;
  // To be called once for a shading point (an index into the group's) whose light is settled by what filter() found:
  // counts the use of the fields that told, where uses are counted.
  void count_filtered(const ShadowGroup& group, uint32_t shading_point, Stats& stats) const;

  // The candidates, as bits, that answer whole lights and that a shading point (an index into the group's) may have
  // between itself and the light. Does not depend on the other shading points, as the group's candidates do.
  uint32_t fields_before(const ShadowGroup& group, const ShadingPointBatch& shading_points,
                         uint32_t shading_point) const;
  // To be called for a shading point on `instance` with those `fields` before it, many of whose light samples are taken
  // for what its probe rays found: as many `answered` and `asked` as of these.
  void count_extrapolated(const ShadowGroup& group, uint32_t fields, uint32_t instance, uint64_t answered,
                          uint64_t queried, Stats& stats) const;

  // For --check: traces the rays of shading points (indices into the group's) whose whole light find_candidates()
  // called `blocked`, or clear; `samples` for each, one after another. Self-shadowing is what the field of the ray's
  // own object said: that it hides the light, or, of a clear one, that neither it nor any other object does.
  void check_whole(const ShadowGroup& group, bool blocked, std::span<const uint32_t> shading_points, int samples,
                   const ShadowBatch& batch, Stats& stats) const;

  // Whether a group has too many candidates, and parts of it are worth a search of their own before they are traced
  // against the whole scene: where fields could answer. Monte Carlo gains nothing by it
  // (docs/decisions/010-overflow.md).
  bool gains_by_splitting(const ShadowGroup& group) const;

  // Sets batch.blocked and batch.exact of every active slot (rays.tmax >= 0); both are 0 on entry, and stay 0 for
  // inactive slots. The rays leave shading points that `group` was made for, or some of them. Adds what it did to
  // `stats` (rays_exact, rays_crossing, look-ups, checks; not rays_shadow); time spent baking goes to stats.time_bake
  // and is left out of time.secondary by the caller. Shading points that see a part of a light no wider than
  // k_cells_across cells and lie within an object's ball are answered by rays, up to k_estimating_tolerance: certified
  // cells are wrong about few of them, but about many rays of the same one (docs/decisions/019-penumbrae.md).
  void answer(const ShadowGroup& group, LightSeen seen, ShadowBatch& batch, Stats& stats) const;

 private:
  struct Workspace;  // hybrid/visibility/shadow_workspace.h

  void forget_distant(const ShadingPointBatch& shading_points, ShadowGroup& group) const;
  void query_cones(const ShadowInstance& occluder, const ShadingPointBatch& shading_points, const ShadowGroup& group,
                   Workspace& work, Stats& stats) const;
  // query_and_bake() with the occluder's field.
  template <class Query>
  void bake_and_repeat(const ShadowInstance& occluder, size_t size, ConeUnknowns& unknowns, Stats& stats,
                       int most_rounds, const Query& query) const;
  bool trusts_depth(const ShadowInstance& occluder, const ShadowGroup& group, LightSeen seen) const;
  void classify(const ShadowGroup& group, LightSeen seen, const ShadowBatch& batch, Workspace& work,
                Stats& stats) const;
  void bake_unknown(const ShadowInstance& occluder, const SegmentTask& task, int32_t slot, const ShadowBatch& batch,
                    Workspace& work, Stats& stats) const;
  FieldUse& use_of(const ShadowInstance& occluder, Stats& stats) const;
  void count_uses(const ShadowInstance& occluder, const ShadowBatch& batch, const Workspace& work, Stats& stats) const;
  void check_answers(const ShadowInstance& occluder, const ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void trace(const ShadowGroup& group, ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void trace_all(ShadowBatch& batch, Workspace& work, Stats& stats) const;

  const Scene& scene_;
  const Accel& accel_;
  const SegmentKernels& kernels_;
  const ThesisKernels& thesis_kernels_;
  AnswererSettings settings_;
  ShadowCandidates candidates_;
  std::vector<ShadowInstance> instances_;  // one per instance
  mutable tbb::enumerable_thread_specific<std::unique_ptr<Workspace>> workspaces_;
};

}  // namespace fieldtrace
