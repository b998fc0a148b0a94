// Answers shadow rays: candidate culling, field look-ups where a candidate has a field, exact rays for the rest. Monte
// Carlo is the same code without fields, so that it gets the same culling and the same packets.
//
// Two steps. find_candidates() finds the objects that may stand between a group of shading points and a light, and the
// shading points that any of them may shadow; the others need no shadow rays. answer() then decides every ray of the
// remaining shading points. A ray that only one candidate leaves undecided is traced against that candidate alone,
// others against the whole scene; a group with candidate overflow (more than k_most_candidates) goes to the whole scene
// without further culling.
//
// Files: shadow_answerer.cpp culls; shadow_answerer_lights.cpp looks up whole lights and strata,
// shadow_answerer_rays.cpp single rays, and traces the rest; shadow_answerer_checks.cpp counts.
// Thread-safety: const functions may be called from any number of threads; fields grow on demand meanwhile.
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
  bool check = false;            // also trace an exact ray for every field's answer
  bool force_undecided = false;  // look up, then treat every cell as undecided
  bool whole_lights = true;      // answer whole lights before single rays, at tolerances above 0
  bool count_uses = false;       // fill Stats::field_uses
  // Trace every shadow ray against the whole scene. A shading point's light then cannot depend on its group, which
  // otherwise decides whether the light is sampled or, where nothing can block it, known in closed form.
  bool whole_scene = false;
  // Per shape: not 0 where its field does not answer rays from the object itself. Empty: all fields do.
  std::vector<uint8_t> self_to_rays = {};
};

// Beyond this many candidates for one group, one traversal of the whole scene costs less than their tests
// (docs/decisions/010-overflow.md).
inline constexpr size_t k_most_candidates = 16;

// With fewer light samples at a shading point, looking up single rays costs no more than looking up the whole light.
inline constexpr int k_fewest_cone_samples = 4;

// With fewer strata than this, look-ups treat each as 1 / k_fewest_strata of the light: larger footprints would blur.
inline constexpr int k_fewest_strata = 16;

// Half width, in texels, of a whole light's disc at the blocker below which strata are refused: contact shadows, which
// single rays answer better (docs/decisions/014-strata.md).
inline constexpr float k_least_light_disc = 2.0f;

// Lights wider than this, in direction cells, are seen through so many cells that the cells' errors do not add up.
inline constexpr float k_cells_across = 3.0f;

// From this tolerance on (the default), answers are estimates where that saves much: cones look for surfaces only in
// the middle half of a chord, and a few probe rays may stand for a whole light. Below it, only what cells certify is
// answered.
inline constexpr float k_estimating_tolerance = 0.1f;

// ShadowAnswerer::filter() left a shading point's strata undecided. Seen edge-on, thin instances cast shadows that pass
// between the lattice's points of probe rays: there all light samples are taken.
inline constexpr uint8_t k_refused = 1;
inline constexpr uint8_t k_refused_by_thin = 2;

// A group's light, and what find_candidates() found. The caller keeps it between the two steps.
struct ShadowGroup {
  LightExtent light;
  std::vector<uint32_t> candidates;  // instances; more than k_most_candidates: candidate overflow
  int light_samples = 1;             // that each shading point would send
  AlignedVector<int32_t> met;        // per shading point: not 0 if its cone meets some candidate's bounds
  AlignedVector<int32_t> shadow;     // per shading point: k_may_shadow, k_light_blocked; 0: nothing blocks the light
  // Per shading point that may be shadowed: bits of the candidates that may answer by strata; and whether other
  // candidates need single rays.
  AlignedVector<int32_t> by_strata, by_rays;
  // With --check, per shading point whose light is blocked: the instance whose field answered that.
  std::vector<uint32_t> blocked_by;
};

// What is known about how much of the light the shading points of the rays see.
enum class LightSeen { unknown, in_part };

struct ShadowInstance;  // hybrid/visibility/shadow_instance.h

class ShadowAnswerer {
 public:
  // traits[s] belongs to shape s. fields[s] is its field, or null: its instances are then answered by exact rays.
  // Instead a shape may have a field in the thesis' chart in thesis_fields[s], which answers every single ray that
  // meets it, whatever the tolerance; empty: none. The scene, `accel` and the fields must outlive this.
  ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                 const std::vector<Field*>& fields, const AnswererSettings& settings,
                 const std::vector<const ThesisField*>& thesis_fields = {});
  ~ShadowAnswerer();

  // Fills `group` for the shading points' positions, geometric normals, errors and instances; the caller sets
  // group.light and group.light_samples. With fields, whole lights are answered where they can be: such shading points
  // need no rays.
  void find_candidates(const ShadingPointBatch& shading_points, ShadowGroup& group, Stats& stats) const;

  // Whether agreeing probe rays may stand for a whole light: where some candidate of the group answers whole lights by
  // a field, from k_estimating_tolerance on.
  bool extrapolates(const ShadowGroup& group) const;
  // Whether answer() distrusts some candidate's depth cells, given what is seen of the light.
  bool doubts_depth(const ShadowGroup& group, LightSeen seen) const;
  bool checks() const { return settings_.check; }
  // Filters strata of a light, `strata` for each of `shading_points` (indices into the group's; their by_rays must be
  // 0), as sample_light() laid them out in `batch`: sets batch.clear. refused[i] becomes k_refused for shading points
  // that some field refuses, k_refused_by_thin where the instance does not keep angles, else 0. Shares of shading
  // points that are refused are meaningless.
  void filter(const ShadowGroup& group, std::span<const uint32_t> shading_points, int strata, ShadowBatch& batch,
              std::vector<uint8_t>& refused, Stats& stats) const;
  // Call once for a shading point (an index into the group's) whose light filter() has settled: counts the use of the
  // fields that answered, if uses are counted.
  void count_filtered(const ShadowGroup& group, uint32_t shading_point, Stats& stats) const;

  // Bits of the candidates that answer whole lights and may stand between a shading point (an index into the group's)
  // and the light. Does not depend on the other shading points, as the group's candidates do.
  uint32_t fields_before(const ShadowGroup& group, const ShadingPointBatch& shading_points,
                         uint32_t shading_point) const;
  // Call for a shading point on `instance`, with those `fields` before it, whose probe rays stand for light samples:
  // counts `answered` and `undecided` of these as uses of the fields.
  void count_extrapolated(const ShadowGroup& group, uint32_t fields, uint32_t instance, uint64_t answered,
                          uint64_t undecided, Stats& stats) const;

  // For --check: traces the rays of shading points (indices into the group's) whose whole light find_candidates() found
  // `blocked`, or clear; `samples` consecutive rays for each. Self-shadowing counts what the field of the ray's object
  // answered: that it blocks the light or, of a clear light, that neither it nor any other candidate does.
  void check_whole(const ShadowGroup& group, bool blocked, std::span<const uint32_t> shading_points, int samples,
                   const ShadowBatch& batch, Stats& stats) const;

  // Whether a group with candidate overflow should be split, and its parts searched, before tracing against the whole
  // scene: only where fields could answer. Monte Carlo gains nothing by it (docs/decisions/010-overflow.md).
  bool gains_by_splitting(const ShadowGroup& group) const;

  // Sets batch.blocked and batch.exact of every active slot (rays.tmax >= 0); both must be 0 on entry, and stay 0 for
  // inactive slots. The rays must leave shading points that `group` was made for. Adds to `stats` rays_exact,
  // rays_crossing, look-ups and checks, not rays_shadow; baking time goes to stats.time_bake, and the caller subtracts
  // it from time.secondary. Up to k_estimating_tolerance, where a light is seen in part and no wider than
  // k_cells_across cells, rays that start inside an object's ball are traced: certified cells are wrong about few
  // shading points there, but about many rays of the same one (docs/decisions/019-penumbrae.md).
  void answer(const ShadowGroup& group, LightSeen seen, ShadowBatch& batch, Stats& stats) const;

 private:
  struct Workspace;  // hybrid/visibility/shadow_workspace.h

  void forget_distant(const ShadingPointBatch& shading_points, ShadowGroup& group) const;
  void query_cones(const ShadowInstance& occluder, const ShadingPointBatch& shading_points, const ShadowGroup& group,
                   Workspace& work, Stats& stats) const;
  bool find_overlaps(const ShadowGroup& group, Workspace& work) const;
  static void multiply_shares(size_t slot, Workspace& work, AlignedVector<float>& clear);
  // query_and_bake() with the occluder's field.
  template <class Query>
  void bake_and_repeat(const ShadowInstance& occluder, size_t size, ConeUnknowns& unknowns, Stats& stats,
                       int most_rounds, const Query& query) const;
  bool trusts_depth(const ShadowInstance& occluder, const ShadowGroup& group, LightSeen seen) const;
  bool trusts_cells(const ShadowInstance& occluder, const ShadowGroup& group) const;
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
