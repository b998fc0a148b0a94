// The test cases of the thesis' section 4, with the figures that the thesis reports for them.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "tools/thesis/scene.h"

namespace fieldtrace {

inline constexpr const char* k_thesis_bunny = "/usr/share/glmark2/models/bunny.obj";

// The thesis' figures for one case and one M; negative: not given.
struct ThesisFigures {
  int m = 0;
  double rms = -1, rms_blurred = -1, milliseconds = -1;
};

// The entry of `all` for this M; no figures if there is none.
ThesisFigures figures_at(const std::vector<ThesisFigures>& all, int m);

struct ThesisCase {
  PhongScene scene;
  size_t thesis_triangles = 0;  // as the thesis counts them; 0: not given
  bool polished = false;        // also compared with a reference of four rays per reflection
  std::vector<ThesisFigures> figures, polished_figures;
  double thesis_gpu_ms = -1, thesis_cpu_ms = -1;  // the thesis' references by exact rays
  double polished_gpu_ms = -1, polished_cpu_ms = -1;
};

// In the thesis' order. If the file `bunny` is missing, the two scenes with it use a torus knot of about as many
// triangles, and their titles say so.
std::vector<ThesisCase> thesis_cases(const std::string& bunny = k_thesis_bunny);

// The objects of the cases.
TriangleMesh thesis_supershape_1(int around = 128, int along = 64);
TriangleMesh thesis_supershape_2(int around = 128, int along = 64);

// One light and one object of at least `triangles` triangles: an ever finer supershape.
PhongScene thesis_growing_scene(size_t triangles);

}  // namespace fieldtrace
