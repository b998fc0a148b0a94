// Direct light at a wave of path vertices: samples every light, has the shadow rays answered, adds up what arrives.
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

// A part of a batch with too many objects about it is halved if its shading points send this many rays each to a light,
// and the part more than that many: with fewer, searching costs more than is saved (docs/decisions/010-overflow.md).
inline constexpr int k_fewest_splitting_samples = 16;
inline constexpr int k_smallest_part_rays = 512;

// Points of a light that are tried first, where whole lights may be answered at once: if a shading point sees all of
// them, or none, it is taken to see all of the light, or none. About 2 sqrt(light_samples), on a lattice from edge to
// edge of the light: an edge that crosses the light hides or shows some of its rim, which the outer points follow
// (docs/decisions/019-penumbrae.md). Lights that have no rim to speak of are tried at their first samples. A count of
// 0: none. is_wide: to shading points that see it wider than k_coarse_light_degrees.
LightSampleRange probe_rays(LightKind kind, int light_samples, bool is_wide);
inline constexpr int k_least_lattice = 3;  // points along a side
inline constexpr int k_least_wide_lattice = 4;
// Degrees across from which lights are wide. Before an object of several layers more than one edge crosses them: their
// parts are not filtered where there are probe rays, and coarse lattices are not believed
// (docs/decisions/014-strata.md).
inline constexpr float k_coarse_light_degrees = 23.0f;
// Just within the rim: on it, rounding could take points off the light.
inline constexpr float k_lattice_extent = 1.0f - 0x1p-10f;

// The strata that a light is cut into for so many samples, where fields may answer for parts: a grid about as
// wide as high, of no more cells than samples.
LightSampleRange stratum_grid(int light_samples);
// With fewer samples single points of the light stand for strata: so few cells would show.
inline constexpr int k_fewest_grid_samples = 9;
inline constexpr int k_most_grid_strata = 256;
// A stratum tells as much as this many rays or more (docs/decisions/014-strata.md).
inline constexpr int k_samples_per_stratum = 3;
// Lights are tried in this many strata first, if that is fewer by a third or more: most are found clear or hidden.
inline constexpr int k_first_strata = 16;

// How much the two means of a light's weight may differ, over either, where its edge is followed.
inline constexpr float k_most_uneven = 0.15f;

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `firsts`, if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  // What gather() was given, and the light that it is at.
  struct Job {
    std::span<const PathVertex> vertices;
    std::span<const PathState> paths;
    int light_samples = 1;
    std::span<FirstHit> firsts;
    std::span<Rgb> arriving;
    Stats& stats;
    uint32_t light = 0;
  };
  // A part of lit_, [begin, end).
  struct Part {
    size_t begin = 0, end = 0;
  };

  // Lights one part by one light. Leaves it undone, and its halves in parts_, if halve() says so.
  void gather_part(const Job& job, const Part& part);
  // Sorts places_ into those that some object may shadow, those that nothing can, and those that see nothing of the
  // light.
  void split_shading_points(const Job& job);
  // Where candidates_ are too many for the part and halves may have fewer: pushes the halves onto parts_, true.
  bool split(const Job& job, const Part& part);
  // For --check: traces what split_shading_points() took for certain.
  void check_split(const Job& job);
  // Has parts of the light filtered for those of shadowed_ whose candidates allow it. They go to free_ or dark_, or are
  // added up; what fields cannot tell of stays in shadowed_.
  void query_strata(const Job& job);
  bool is_wide(uint32_t place) const;  // the light, as a shading point sees it
  // The same for filtered_ by one set of strata; shading points that see a part of the light stay in filtered_ unless
  // `last`.
  void filter_strata(const Job& job, const LightSampleRange& strata, bool last);
  // Tries the light at `points` for those of shadowed_ that fields may answer; of these all, or those to which it is
  // wide, or the others. They go to free_ or dark_ where all points agree; where they do not, they are lit by following
  // an edge, or go to penumbrae_; whoever has too little of the light above the horizon stays.
  enum class Probed { all, narrow, wide };
  void query_probe_rays(const Job& job, const LightSampleRange& points, Probed tried);
  // Counts the samples that are taken for what `asked` points found, `exact` of them by rays.
  void count_extrapolated(const Job& job, uint32_t shading_point, uint32_t fields, size_t queried, size_t exact);
  // Lights those of edged_ whose light one edge cuts, and whose points took rays for the most part, by where the edge
  // crosses the lattice's lines; the others go to penumbrae_ (docs/decisions/020-edges.md).
  void follow_edges(const Job& job, int side);
  // Asks those points of lattices again that fields told of, and that only rays are believed about.
  void query_lattices_again(const Job& job, int side);
  // Leaves those to samples whose light weighs too unevenly for one point a cell.
  void weigh_cells(const Job& job, int side);
  // Asks about the cells that no edge crosses; whose edge they contradict is not followed.
  void query_witnesses(const Job& job, int side);
  // Where the edges lie, and what they leave of the lattices' cells.
  void narrow_crossings(const Job& job, int side, int bisection_steps);
  void measure_edges(int side);
  // Asks on either side of the edges' pieces; who is contradicted is not followed.
  void query_beside_edges(const Job& job, int side, int bisection_steps);
  // Adds up the light of those of edged_ that are followed.
  void add_edged(const Job& job, int side);
  // All samples of shadowed_ answered and added up; free shading points' without asking.
  void gather_shadowed(const Job& job, LightSeen seen);
  void gather_free(const Job& job);
  // Takes the shading points out of free_ whose light has a closed form, and lights them by it.
  void gather_closed(const Job& job);
  // For the layers: counts the rays of shading points that see nothing of the light.
  void count_dark(const Job& job);

  // Fills places_ for a part, unless they are there already.
  void place_shading_points(const Job& job, const Part& part);
  const PathVertex& vertex_of(const Job& job, uint32_t place) const {
    return job.vertices[lit_[places_part_.begin + place]];
  }
  static LightSampleRange all_samples(const Job& job) { return {job.light_samples, 0, job.light_samples}; }
  void sample_group(const Job& job, const LightSampleRange& range);
  // chosen[i] = all[indices[i]].
  static void select_shading_points(const ShadingPointBatch& all, std::span<const uint32_t> indices,
                                    ShadingPointBatch& chosen);
  // Points of the light for single shading points, asked together: the answer of the i-th placed is slot i of shadows_.
  void clear_points();
  void place_point(uint32_t owner, const SquarePoint& at);  // owner: index into edged_
  void sample_points(const Job& job);
  void query_points(const Job& job);
  void count_queried();
  bool is_hidden(size_t slot) const { return shadows_.blocked[slot] || shadows_.rays.tmax[slot] < 0.0f; }
  // Means over a light: of its samples' weights, and of what lies above the horizon.
  struct LightMean {
    float weight = 0, above = 0;
    void add(const ShadowBatch& batch, size_t slot, float part) {
      weight += part * batch.weight[slot];
      above += batch.rays.tmax[slot] >= 0.0f ? part : 0.0f;
    }
  };
  // For the shading point whose lattice begins at that slot.
  LightMean mean_by_corners(size_t begin, int side) const;
  // mean_of: over how many samples the mean is taken.
  LightEstimate estimate_of(const Job& job, int mean_of) const;
  // Adds up and counts the rays of shading point r of group_, `samples` of them; and of all of group_.
  void add_shading_point(const Job& job, const LightEstimate& light, size_t r, int samples);
  void add_group(const Job& job, int samples);

  const TransportContext& context_;
  ShadingPointBatch shading_points_;  // group_
  ShadowBatch shadows_;
  std::vector<uint32_t> lit_;  // vertices that take light samples
  ShadingPointBatch places_;   // the current part of them
  Part places_part_;
  // Of these, as indices into places_: those of the current batch, and how split_shading_points() sorted them.
  std::vector<uint32_t> group_, shadowed_, free_, dark_, filtered_, penumbrae_;
  std::vector<uint32_t> fields_before_;  // per shading point of group_
  std::vector<uint8_t> refused_;         // per shading point of group_
  // Shading points whose lattices differ, and that may be lit by following one edge.
  struct EdgedShadingPoint {
    uint32_t shading_point = 0, fields = 0;  // of places_; as in fields_before_
    uint32_t active = 0;                     // points of its lattice above the horizon
    uint32_t queried = 0, exact = 0;         // points of the light so far, and those that rays answered
    LightMean by_corners, by_middles;        // of the lattice's cells
    bool is_followed = false;
  };
  std::vector<EdgedShadingPoint> edged_;
  // Of edged_, one after the other, per point of their lattices: 1: hidden, or below the horizon; k_untraced: no ray
  // says so, and fields are doubted.
  static constexpr uint8_t k_untraced = 2;
  std::vector<uint8_t> lattices_;
  std::span<const uint8_t> lattice(size_t edged, size_t points) const {
    return std::span(lattices_).subspan(edged * points, points);
  }
  std::vector<EdgeCrossing> crossings_;
  std::vector<float> places_on_;  // per crossing: where on its line it is asked
  std::vector<CellSeen> cells_seen_;
  std::vector<uint32_t> owners_, queried_of_;  // of each point: index into edged_, into places_
  AlignedVector<float> point_x_, point_y_;
  std::vector<size_t> found_;  // of each point: what of lattices_ its answer is about
  ShadowGroup candidates_;
  std::vector<Part> parts_;      // of the batch, not lit yet by the current light
  bool in_split_order_ = false;  // the batch's part of lit_ is in the order of order_by_median_splits
  std::vector<PlacedIndex> placed_;
};

}  // namespace fieldtrace
