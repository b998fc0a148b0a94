// Answers glossy rays by certified nearest hits of fields: a miss, or a surface point whose error is small against the
// lobe's footprint. What no certificate settles is traced, as are all rays that are not glossy.
//
// Objects with fields whose ball a ray meets are looked up front to back, until the nearest hit lies before the next
// ball. That hit counts if every other hit or undecided object surely lies behind it. Where it lies on the triangle
// that its cell stores, it is moved there, and then equals a traced hit but for what may lie within the cell's error
// bound. Objects without fields are traced. An answer depends on the ray, the scene and the settings alone.
// Thread-safety: const functions may be called from any number of threads, each with its own workspace; fields grow on
// demand meanwhile.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/direction_order.h"
#include "hybrid/visibility/ray_subset.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// How far a lobe may be blurred, as a tangent seen from the surface, per unit of the lobe's alpha and of tolerance: by
// the half width of a filter footprint, or by the error of a hit. At the default an eighth of alpha: the slopes of a
// lobe's microfacets are spread by about alpha, reflected directions by twice that.
inline constexpr float k_blur_of_tolerance = 1.25f;

// What a hit needs beyond its entry in a HitBatch (t, instance, and as primitive a triangle near it). World space.
struct CertifiedHit {
  uint32_t ray = 0;
  Vec3 normal = Vec3(0.0f);  // unit, on the side that the ray comes from
  float error = 0.0f;        // bound on the point's distance from the surface, along the normal
};

struct HitWorkspace {
  std::vector<CertifiedHit> certified;

  std::vector<uint32_t> queried, exact;  // queried: looked up; exact: traced
  DirectionOrder order;
  HitQueries queries;  // of `queried`
  HitBatch others, found;
  std::vector<uint32_t> front_to_back;
  std::vector<HitAnswers> answers;  // by object
  HitUnknowns unknowns;
  RaySubset some;
};

// The surface at a certified hit; not for exact hits.
SurfacePoint surface_of(const Scene& scene, const RayBatch& rays, const HitBatch& hits, const CertifiedHit& hit);

class HitAnswerer {
 public:
  // With fewer triangles a ray costs no more than the look-ups (docs/decisions/016-certified-hits.md).
  static constexpr size_t k_fewest_triangles = 1000000;

  // Instances that fields of these parameters can answer for; none if there are too many. Their meshes have at least
  // `fewest_triangles` triangles; they are opaque and emit no light; where they are textured, cells are no wider than a
  // few of their triangles.
  static std::vector<uint32_t> suited_instances(const Scene& scene, std::span<const ShapeTraits> traits,
                                                const FieldParameters& parameters, size_t fewest_triangles);

  // Rays that baking a field of these parameters takes for hits from all directions.
  static double estimated_bake_rays(const FieldParameters& parameters);

  // fields[s] belongs to shape s, and is not null for `instances`, which must be suited. All references must outlive
  // this.
  HitAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
              const std::vector<Field*>& fields, std::span<const uint32_t> instances, const AnswererSettings& settings);
  ~HitAnswerer();

  // Finds where rays[i] (unit, infinite) of paths[i] ends, for each i of `which`; other entries of `hits` stay as they
  // are. work.certified receives the hits that are not exact. With --check, answers are counted in `stats`.
  void intersect(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                 HitBatch& hits, HitWorkspace& work, Stats& stats) const;
  // The same without the rays that would be traced: these are then work.exact.
  void look_up(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which, HitBatch& hits,
               HitWorkspace& work, Stats& stats) const;

 private:
  struct Object;
  enum class Verdict { miss, hit, undecided };
  struct Nearest;

  void choose_queried(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                      HitWorkspace& work) const;
  void query(HitWorkspace& work, Stats& stats) const;
  void trace_others(HitWorkspace& work) const;
  void order_objects(HitWorkspace& work) const;
  void query_object(const Object& object, HitAnswers& answers, HitWorkspace& work, Stats& stats) const;
  // False: the rest is not to be baked.
  bool bake(const Object& object, HitUnknowns& unknowns, Stats& stats) const;
  void find_triangle(const HitWorkspace& work, size_t j, Nearest& nearest) const;
  Nearest put_together(const HitWorkspace& work, size_t j) const;
  void settle(HitBatch& hits, HitWorkspace& work, Stats& stats) const;
  void check_answers(std::span<const PathState> paths, HitWorkspace& work, Stats& stats) const;
  bool is_wrong(const HitWorkspace& work, size_t j, const Nearest& nearest, float alpha) const;

  const Scene& scene_;
  const Accel& accel_;
  const SegmentKernels& kernels_;
  float tolerance_;
  bool check_;
  SliceDemands demands_;
  std::vector<Object> objects_;
  std::vector<uint8_t> is_object_;              // by instance
  std::shared_ptr<const Accel::Group> others_;  // the other instances; null: there are none
};

}  // namespace fieldtrace
