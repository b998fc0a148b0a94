// Direct light at a wave of path vertices: samples every light, has the shadow rays answered and adds up the reflected
// light.
//
// Batches of about k_shadow_batch rays stay in the second-level cache between the three steps.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "hybrid/light/light_edge.h"
#include "hybrid/light/reflected_light.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/visibility/median_split.h"

namespace fieldtrace {

inline constexpr int k_shadow_batch = 8192;

// A part of a batch with candidate overflow is halved if each of its shading points sends at least
// k_fewest_splitting_samples rays to the light, and the part more than k_smallest_part_rays: below that, searching for
// candidates costs more than it saves (docs/decisions/010-overflow.md).
inline constexpr int k_fewest_splitting_samples = 16;
inline constexpr int k_smallest_part_rays = 512;

// Probe rays to a light, tried before its samples where fields may answer whole lights: a shading point that sees all
// of them, or none, is taken to see all of the light, or none. About 2 sqrt(light_samples), on a lattice that spans the
// light from rim to rim: an edge across the light hides or shows some of its rim, where the outer points lie
// (docs/decisions/019-penumbrae.md). Lights without a rim in their sample square are probed at their first samples.
// count = 0: none. is_wide: for shading points that see the light wider than k_coarse_light_degrees.
LightSampleRange probe_rays(LightKind kind, int light_samples, bool is_wide);
inline constexpr int k_least_lattice = 3;  // points along a side
inline constexpr int k_least_wide_lattice = 4;
// Angular diameter from which lights are wide. Before an object of several layers more than one edge crosses them:
// their strata are not filtered where there are probe rays, and coarse lattices are not trusted
// (docs/decisions/014-strata.md).
inline constexpr float k_coarse_light_degrees = 23.0f;
// Just inside the rim: on it, rounding could put points off the light.
inline constexpr float k_lattice_extent = 1.0f - 0x1p-10f;

// The strata that a light with so many samples is cut into where fields may answer for strata: a roughly square grid of
// no more cells than samples.
LightSampleRange stratum_grid(int light_samples);
// With fewer samples, single points of the light stand for strata: so coarse a grid would show.
inline constexpr int k_fewest_grid_samples = 9;
inline constexpr int k_most_grid_strata = 256;
// A stratum is worth at least this many rays (docs/decisions/014-strata.md).
inline constexpr int k_samples_per_stratum = 3;
// A grid of this many strata is tried first if it is smaller by a third or more: most lights prove clear or hidden.
inline constexpr int k_first_strata = 16;

// An edge is followed only where the two means of the light's weight differ by no more than this, relative to the
// midpoint rule's.
inline constexpr float k_most_uneven = 0.15f;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `firsts`, if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  // What gather() was given, and the light being gathered.
  struct Job {
    std::span<const PathVertex> vertices;
    std::span<const PathState> paths;
    int light_samples = 1;
    std::span<FirstHit> firsts;
    std::span<Rgb> arriving;
    Stats& stats;
    uint32_t light = 0;
  };
  // A range [begin, end) of lit_.
  struct Part {
    size_t begin = 0, end = 0;
  };

  // Lights one part by one light; if split() divides the part, its halves are left in parts_ instead.
  void gather_part(const Job& job, const Part& part);
  // Sorts places_ into points that some object may shadow, points that nothing can shadow, and points that see nothing
  // of the light.
  void split_shading_points(const Job& job);
  // On candidate overflow, where halves of the part may have fewer candidates: pushes the halves onto parts_, true.
  bool split(const Job& job, const Part& part);
  // For --check: traces what split_shading_points() settled.
  void check_split(const Job& job);
  // Filters strata of the light for those of shadowed_ whose candidates allow it. They move to free_ or dark_, or are
  // added up; those that fields refuse stay in shadowed_.
  void query_strata(const Job& job);
  bool is_wide(uint32_t place) const;  // the light, as a shading point sees it
  // The same for filtered_ with one set of strata; shading points that see a part of the light stay in filtered_ unless
  // `last`.
  void filter_strata(const Job& job, const LightSampleRange& strata, bool last);
  // Sends probe rays to `points` for those of shadowed_ that fields may answer: all of them, or only those to which the
  // light is wide, or only the others. Where all probe rays agree, points move to free_ or dark_; where not, an edge is
  // followed, or they move to penumbrae_. Points that agree but have too little of the light above the horizon stay.
  enum class Probed { all, narrow, wide };
  void query_probe_rays(const Job& job, const LightSampleRange& points, Probed tried);
  // Counts the light samples that `queried` probe rays, `exact` of them traced, stand for.
  void count_extrapolated(const Job& job, uint32_t shading_point, uint32_t fields, size_t queried, size_t exact);
  // Lights those of edged_ whose light is cut by one edge and most of whose probe rays were traced, from where the edge
  // crosses the lattice's lines; the others move to penumbrae_ (docs/decisions/020-edges.md).
  void follow_edges(const Job& job, int side);
  // Repeats the probe rays that fields answered where only traced rays are trusted.
  void query_lattices_again(const Job& job, int side);
  // Stops following the edge where the light's weight is too uneven for one point a cell.
  void weigh_cells(const Job& job, int side);
  // Probes the cells that no edge crosses; an edge that they contradict is not followed.
  void query_witnesses(const Job& job, int side);
  // Bisects the crossings, then measures what the edges leave of the lattices' cells.
  void narrow_crossings(const Job& job, int side, int bisection_steps);
  void measure_edges(int side);
  // Probes both sides of the edges' straight pieces; an edge that is contradicted is not followed.
  void query_beside_edges(const Job& job, int side, int bisection_steps);
  // Adds up the light of those of edged_ whose edge is followed.
  void add_edged(const Job& job, int side);
  // Answer all samples of shadowed_ and add them up; those of free_ are added without being answered.
  void gather_shadowed(const Job& job, LightSeen seen);
  void gather_free(const Job& job);
  // Lights those of free_ whose light has a closed form by it, and removes them from free_.
  void gather_closed(const Job& job);
  // For the layers: counts the rays of shading points that see nothing of the light.
  void count_dark(const Job& job);

  // Fills places_ for a part, unless it holds that part already.
  void place_shading_points(const Job& job, const Part& part);
  const PathVertex& vertex_of(const Job& job, uint32_t place) const {
    return job.vertices[lit_[places_part_.begin + place]];
  }
  static LightSampleRange all_samples(const Job& job) { return {job.light_samples, 0, job.light_samples}; }
  // Those of places_: places_ itself, or a copy in shading_points_.
  const ShadingPointBatch& selected(std::span<const uint32_t> indices);
  void sample_group(const Job& job, const LightSampleRange& range);
  // chosen[i] = all[indices[i]].
  static void select_shading_points(const ShadingPointBatch& all, std::span<const uint32_t> indices,
                                    ShadingPointBatch& chosen);
  // Points on the light, each for one shading point, answered in one batch: the i-th one placed has slot i of shadows_.
  void clear_points();
  void place_point(uint32_t owner, const SquarePoint& at);  // owner: index into edged_
  void sample_points(const Job& job);
  void query_points(const Job& job);
  void count_queried();
  bool is_hidden(size_t slot) const { return shadows_.blocked[slot] || shadows_.rays.tmax[slot] < 0.0f; }
  // Means over a light: of its samples' weights, and of the share above the horizon.
  struct LightMean {
    float weight = 0, above = 0;
    void add(const ShadowBatch& batch, size_t slot, float part) {
      weight += part * batch.weight[slot];
      above += batch.rays.tmax[slot] >= 0.0f ? part : 0.0f;
    }
  };
  // For the shading point whose lattice begins at slot `begin` of shadows_.
  LightMean mean_by_corners(size_t begin, int side) const;
  // mean_of: the number of samples that the mean is taken over.
  LightEstimate estimate_of(const Job& job, int mean_of) const;
  // Adds the light and counts the rays of shading point r of group_, with `samples` slots; or those of all of group_.
  void add_shading_point(const Job& job, const LightEstimate& light, size_t r, int samples);
  void add_group(const Job& job, int samples);

  const TransportContext& context_;
  ShadingPointBatch shading_points_;  // of selected()
  ShadowBatch shadows_;
  std::vector<uint32_t> lit_;  // vertices that take light samples
  ShadingPointBatch places_;   // the current part of lit_
  Part places_part_;
  // Indices into places_: those of the current batch, and how split_shading_points() sorted the part.
  std::vector<uint32_t> group_, shadowed_, free_, dark_, filtered_, penumbrae_;
  AlignedVector<float> irradiance_;      // per shading point of free_
  std::vector<uint32_t> fields_before_;  // per shading point of group_
  std::vector<uint8_t> refused_;         // per shading point of group_
  // Shading points whose probe rays differ, and that may be lit by following one edge.
  struct EdgedShadingPoint {
    uint32_t shading_point = 0, fields = 0;  // index into places_; as in fields_before_
    uint32_t active = 0;                     // points of its lattice above the horizon
    uint32_t queried = 0, exact = 0;         // points of the light probed so far, and those traced
    LightMean by_corners, by_middles;        // from the corners and the centres of the lattice's cells
    bool is_followed = false;
  };
  std::vector<EdgedShadingPoint> edged_;
  // The lattices of edged_, one after another. 1: the point is hidden or below the horizon. k_untraced: a field
  // answered and is not trusted here.
  static constexpr uint8_t k_untraced = 2;
  std::vector<uint8_t> lattices_;
  std::span<const uint8_t> lattice(size_t edged, size_t points) const {
    return std::span(lattices_).subspan(edged * points, points);
  }
  std::vector<EdgeCrossing> crossings_;
  std::vector<float> places_on_;  // per crossing: the place on its line to be probed
  std::vector<CellSeen> cells_seen_;
  std::vector<uint32_t> owners_, point_places_;  // of each point: index into edged_, and into places_
  AlignedVector<float> point_x_, point_y_;
  std::vector<size_t> found_;  // of each point: its entry in lattices_, or the expected answer
  ShadowGroup candidates_;
  std::vector<Part> parts_;      // of the batch, not yet lit by the current light
  bool in_split_order_ = false;  // the batch's range of lit_ is in the order of order_by_median_splits()
  std::vector<PlacedIndex> placed_;
};

}  // namespace fieldtrace
