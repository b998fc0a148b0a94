// Runs the thesis' test cases: fields for every M and references by exact rays, with errors, times and memory.
//
// Times are in milliseconds of wall clock, for rendering alone, without loading and baking. Each is the least of
// several renders, because other load on the machine can only add to it.
// Thread-safety: uses all threads of the caller's TBB arena; run one at a time, or times disturb each other.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/simd/isa.h"
#include "tools/thesis/cases.h"

namespace fieldtrace {

struct ThesisRunOptions {
  bool quick = false;  // images of 96 x 96, M = 32 only, one render per time, few triangles
  Isa isa = Isa::automatic;
  std::string bunny = k_thesis_bunny;
  std::string scratch_folder;  // must exist; for temporary files

  int size() const { return quick ? 96 : 512; }
  std::vector<int> resolutions() const { return quick ? std::vector{32} : std::vector{32, 64, 128}; }
  int repeats() const { return quick ? 1 : 9; }
};

// One case at one M.
struct ThesisRow {
  int m = 0;
  double rms = 0, rms_blurred = 0;                      // against the mirror reference, or the only one
  double rms_polished = -1, rms_polished_blurred = -1;  // against four rays per reflection
  double milliseconds = 0, bake_seconds = 0;            // bake: of all its objects, also if baked for an earlier case
  uint64_t bytes_distance = 0, bytes_normal = 0, bytes_vdb = 0;
  std::string picture, difference_picture;  // data: URIs
};

struct ThesisCaseResult {
  std::string name, title;
  size_t triangles = 0, thesis_triangles = 0, lights = 0;
  double exact_ms = 0, polished_ms = -1;
  uint64_t exact_bytes = 0;
  std::string reference_picture, polished_picture;
  std::vector<ThesisRow> rows;
  ThesisCase description;  // with the thesis' figures; without its geometry
};

// One object at increasing tessellation: does the time depend on the number of triangles?
struct ThesisGrowth {
  size_t triangles = 0;
  int m = 0;
  double field_ms = 0, exact_ms = 0, bake_seconds = 0;
};

// A scene of diffuse surfaces in this program's renderers (tools/thesis/hybrid_rows.h).
struct ThesisHybridRow {
  std::string scene, method;
  int spp = 0;
  double tolerance = 0, rms = 0, milliseconds = 0, cold_milliseconds = 0;
  uint64_t bytes = 0;
};

// One chart's look-ups for one object and one set of shading points (tools/thesis/chart_rows.h).
struct ThesisChartRow {
  std::string object, shading_points, chart;
  uint64_t bytes = 0;      // of the complete field
  double tolerance = -1;   // orthographic chart only
  double rmse = 0;         // of shading points' visibility, in [0, 1]
  double exact_share = 0;  // of the rays that cross the ball
  double look_ups_per_ray = 0, ns_per_look_up = 0;
};

struct ThesisReport {
  int size = 0, threads = 0;
  std::string isa;
  bool quick = false;
  std::vector<ThesisCaseResult> cases;
  std::vector<ThesisGrowth> growth;
  std::vector<ThesisChartRow> charts;
  std::vector<ThesisHybridRow> hybrid;
};

struct ThesisRunCallbacks {
  std::function<void(double share, const std::string& stage)> progress;  // from one thread at a time
  const std::atomic<bool>* stop = nullptr;
};

// Returns false if `stop` ended it: `report` then holds the cases and rows finished so far. Throws the errors of
// loading, baking and writing.
bool run_thesis(const ThesisRunOptions& options, const ThesisRunCallbacks& callbacks, ThesisReport& report);

}  // namespace fieldtrace
