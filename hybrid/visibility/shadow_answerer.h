// Answers shadow rays: candidate culling, field look-ups where a candidate has a field, exact rays for the rest. Monte
// Carlo is the same code without fields, so that it gets the same culling and the same packets.
//
// Three steps. find_candidates() finds the objects that may stand between a group of shading points and a light, and
// the shading points that any of them may shadow, and has fields answer whole lights; what they settle needs no shadow
// rays. filter() answers strata of what is open. answer() decides single rays. A ray that only one candidate leaves
// undecided is traced against that candidate alone, others against the whole scene, as are all single rays of a group
// with candidate overflow (more than k_most_candidates).
//
// Each step takes a list of groups, too, whose questions go to a device as one wave; the calls for one group leave it
// out.
//
// Files: shadow_answerer.cpp culls; shadow_answerer_lights.cpp looks up whole lights and strata,
// shadow_answerer_rays.cpp single rays, and traces the rest; shadow_answerer_device.cpp asks a device;
// shadow_answerer_checks.cpp counts.
// Thread-safety: const functions may be called from any number of threads; fields grow on demand meanwhile.
// Determinism: an answer depends on nothing but the ray or shading point, the light and the objects; with candidate
// overflow also on the group's other shading points.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "field/store/risk_classes.h"
#include "field/thesis/thesis_field.h"
#include "field/thesis/thesis_kernels.h"
#include "hybrid/culling/instance_tree.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/query_and_bake.h"
#include "hybrid/visibility/shape_traits.h"
#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace {

struct AnswererSettings {
  Isa isa = Isa::scalar;                  // resolved
  float tolerance = k_default_tolerance;  // [0, 1]
  bool check = false;                     // also trace an exact ray for every field's answer
  bool force_undecided = false;           // look up, then treat every cell as undecided
  bool whole_lights = true;               // answer whole lights before single rays, at tolerances above 0
  bool count_uses = false;                // fill Stats::field_uses
  // Trace every shadow ray against the whole scene. A shading point's light then cannot depend on its group, which
  // otherwise decides whether the light is sampled or, where nothing can block it, known in closed form.
  bool whole_scene = false;
  // Per shape: not 0 where its field does not answer rays from the object itself. Empty: all fields do.
  std::vector<uint8_t> self_to_rays = {};
  // Per shape: bakes for single rays and hits wait until they are due. Empty: they happen at the first question. Must
  // outlive the answerer.
  SliceDemands demands = {};
};

// Beyond this many candidates, one traversal of the whole scene costs less than their tests of single rays
// (docs/decisions/010-overflow.md).
inline constexpr size_t k_most_candidates = 16;

// With fewer light samples in a cluster, its rays cost no more than looking up the whole light.
inline constexpr int k_fewest_cone_samples = 4;

// Half width, in texels, of a whole light's disc at the blocker below which strata are refused: contact shadows, which
// single rays answer better (docs/decisions/014-strata.md).
inline constexpr float k_least_light_disc = 2.0f;

// A group's light, and what find_candidates() found. The caller keeps it between the two steps. Arrays are indexed by
// shading point, each of which may stand for a cluster (ShadingPointBatch::radius).
struct ShadowGroup {
  LightExtent light;
  std::vector<uint32_t> light_samples;  // set by the caller: of all points of a cluster
  // Set by the caller: light samples of a whole pixel. Below k_fewest_cone_samples whole lights are not worth asking
  // fields about, and candidates beyond k_most_candidates are not worth their tests either.
  int64_t pixel_samples = 1;
  bool few_samples() const { return pixel_samples < k_fewest_cone_samples; }
  std::vector<uint32_t> candidates;  // instances, in index order
  bool is_tested = false;            // each shading point has been tested against each candidate
  AlignedVector<int32_t> met;        // not 0 if the cone to the light meets some candidate's bounds
  AlignedVector<int32_t> shadow;     // k_may_shadow, k_light_blocked; 0: nothing blocks the light
  AlignedVector<int32_t> by_rays;    // not 0 if some candidate cannot answer by strata
  // Candidates that may answer by strata, each with a range of open_points: the shading points that it leaves open.
  struct OpenCandidate {
    uint32_t slot = 0;  // index into candidates
    uint32_t begin = 0, end = 0;
  };
  std::vector<OpenCandidate> open;
  std::vector<uint32_t> open_points;
  // With --check, per shading point whose light is blocked: the instance whose field answered that.
  std::vector<uint32_t> blocked_by;
};

struct ShadowInstance;  // hybrid/visibility/shadow_instance.h

class ShadowAnswerer {
 public:
  // traits[s] belongs to shape s. fields[s] is its field, or null: its instances are then answered by exact rays;
  // empty: all are.
  // Instead a shape may have a field in the thesis' chart in thesis_fields[s], which answers every single ray that
  // meets it, whatever the tolerance; empty: none. The scene, `accel` and the fields must outlive this.
  ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                 const std::vector<Field*>& fields, const AnswererSettings& settings,
                 const std::vector<const ThesisField*>& thesis_fields = {});
  ~ShadowAnswerer();

  // A group that find_candidates() fills, and what it asks the device.
  struct CandidateRequest {
    const ShadingPointBatch& points;
    ShadowGroup& group;
    Stats& stats;
    // By candidate: what its bounds leave to ask, whole lights where it answers them.
    std::vector<ConeQuestion> questions = {};
  };
  // The same for filter() and answer().
  struct FilterRequest {
    const ShadowGroup& group;
    const ShadingPointBatch& all;
    std::span<const uint32_t> shading_points;
    int strata;
    ShadowBatch& batch;
    std::vector<uint8_t>& undecided;
    Stats& stats;
    std::vector<StratumQuestion> questions = {};  // by ShadowGroup::open
  };
  struct RayRequest {
    const ShadowGroup& group;
    ShadowBatch& batch;
    Stats& stats;
    bool counts_open = false;                 // traced rays count as Stats::rays_open, too
    std::vector<RayQuestion> questions = {};  // by candidate
  };
  // All of a list, side by side; device() must not be null. Requests must not share what they write, but for the
  // statistics of those that follow one another.
  void find_candidates(std::span<CandidateRequest> requests) const;
  void filter(std::span<FilterRequest> requests) const;
  void answer(std::span<RayRequest> requests) const;

  // Fills `group` for the positions, geometric normals, errors, radii and instances of `points`; the caller sets
  // group.light and group.light_samples. With fields, whole lights are answered where they can be: such shading points
  // need no rays.
  void find_candidates(const CandidateRequest& request) const;

  // Whether strata of the group's light may be filtered: some candidate leaves them to filter().
  bool filters(const ShadowGroup& group) const { return !group.open.empty(); }
  bool checks() const { return settings_.check; }
  // That which answers instead of the CPU, and must outlive this; null: the CPU answers.
  VisibilityDevice* device() const { return device_; }
  void use(VisibilityDevice* device) { device_ = device; }
  // Filters `strata` strata of a light for each of `shading_points` (indices into the group's; their by_rays must be
  // 0), whose rays sample_light() laid out in `batch`: sets batch.clear, and undecided[i] to 1 for strata that are not
  // settled, whose clear[i] is meaningless.
  void filter(const FilterRequest& request) const;

  // For --check: traces the rays of shading points (indices into the group's) whose whole light find_candidates() found
  // `blocked`, or clear; `samples` consecutive rays for each. Self-shadowing counts what the field of the ray's object
  // answered: that it blocks the light or, of a clear light, that neither it nor any other candidate does.
  void check_whole(const ShadowGroup& group, bool blocked, std::span<const uint32_t> shading_points, int samples,
                   const ShadowBatch& batch, Stats& stats) const;

  // The same for strata: compares the share that filter() gave each, or below 0, with `rays` consecutive rays of
  // `batch` to points all over it.
  void check_shares(const ShadowGroup& group, int rays, const ShadowBatch& batch, std::span<const float> shares,
                    Stats& stats) const;

  // Sets batch.blocked and batch.exact of every active slot (rays.tmax >= 0); both must be 0 on entry, and stay 0 for
  // inactive slots. The rays must leave shading points that `group` was made for. Adds to `stats` rays_exact,
  // rays_crossing, look-ups and checks, not rays_shadow; baking time goes to stats.time_bake, and the caller subtracts
  // it from time.secondary.
  void answer(const RayRequest& request) const;

  // For rays that were not sampled from a light: fills `group` for rays from `origins` to group.light, which answer()
  // and look_up() then take.
  void find_ray_candidates(const Bounds3& origins, ShadowGroup& group) const;
  // The part of answer() that traces no ray: batch.exact marks the rays that fields leave undecided.
  void look_up(const ShadowGroup& group, ShadowBatch& batch, Stats& stats) const;

 private:
  struct Workspace;   // hybrid/visibility/shadow_workspace.h
  struct Workspaces;  // one for each thread

  Workspace& workspace() const;  // of the calling thread

  void choose_candidates(const CandidateRequest& request) const;
  void test_candidates(const CandidateRequest& request) const;
  // Sets work.flags for the shading points that the candidate's bounds may shadow, of those that are not settled.
  void meet_bounds(uint32_t slot, const ShadingPointBatch& shading_points, const Sphere& light,
                   const ShadowGroup& group, Workspace& work) const;
  // Tests all shading points against one candidate; with a field, whole lights too. `question`: what was asked about
  // it; null: nothing.
  void test_candidate(uint32_t slot, const ConeQuestion* question, const CandidateRequest& request, const Sphere& light,
                      Workspace& work) const;
  void query_cones(const ShadowInstance& occluder, const ConeTask& task, const ConeQuestion* question,
                   const CandidateRequest& request, Workspace& work) const;
  static Sphere light_with_errors(const ShadingPointBatch& shading_points, const LightExtent& extent);
  static ConeTask cone_task(const ShadowInstance& occluder, const ShadowGroup& group);
  static StratumTask stratum_task(const ShadowInstance& occluder, int strata);
  SegmentTask ray_task(const ShadowInstance& occluder, const ShadowGroup& group) const;
  // What goes to the device (shadow_answerer_device.cpp).
  void ask_cones(CandidateRequest& request) const;
  void ask_strata(FilterRequest& request) const;
  void ask_rays(RayRequest& request) const;
  template <class Question, class Request, class SlotOf>
  void ask_and_bake(std::span<Request> requests, std::vector<Question*> DeviceWave::*list, const SlotOf& slot_of) const;
  void bake_unbaked(const ShadowInstance& occluder, DeviceQuestion::Unbaked& unbaked, Stats& stats) const;
  void multiply_shares(const ShadowGroup& group, uint32_t slot, Workspace& work, AlignedVector<float>& clear) const;
  // query_and_bake() with the occluder's field.
  template <class Query>
  void bake_and_repeat(const ShadowInstance& occluder, size_t size, ConeUnknowns& unknowns, Stats& stats,
                       int most_rounds, const Query& query) const;
  // Looks up all rays; work.exact receives those that are undecided.
  void collect(const RayRequest& request, Workspace& work) const;
  void classify(const RayRequest& request, Workspace& work) const;
  void bake_unknown(const ShadowInstance& occluder, const SegmentTask& task, int32_t slot, const ShadowBatch& batch,
                    Workspace& work, Stats& stats) const;
  FieldUse& use_of(const ShadowInstance& occluder, Stats& stats) const;
  void count_untested(const ShadingPointBatch& shading_points, const ShadowGroup& group, Stats& stats) const;
  void count_uses(const ShadowInstance& occluder, const ShadowBatch& batch, const Workspace& work, Stats& stats) const;
  void check_answers(const ShadowInstance& occluder, const ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void trace(const ShadowGroup& group, ShadowBatch& batch, Workspace& work, Stats& stats) const;
  void trace_all(ShadowBatch& batch, Workspace& work, Stats& stats) const;

  const Scene& scene_;
  const Accel& accel_;
  const SegmentKernels& kernels_;
  const ThesisKernels& thesis_kernels_;
  const ShaftKernel keep_met_by_shafts_;
  AnswererSettings settings_;
  VisibilityDevice* device_ = nullptr;
  InstanceTree tree_;
  std::vector<ShadowInstance> instances_;  // one per instance
  std::unique_ptr<Workspaces> workspaces_;
};

}  // namespace fieldtrace
