// The test cases of the thesis' section 4, and what the thesis reports about them.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

#include "tools/thesis/scene.h"

namespace fieldtrace {

inline constexpr const char* k_thesis_bunny = "/usr/share/glmark2/models/bunny.obj";

// What the thesis says of one case at one M; negative: nothing.
struct ThesisFigures {
  int m = 0;
  double rms = -1, rms_blurred = -1, milliseconds = -1;
};

// Of `all`, what is said at this M; nothing if that is not among them.
ThesisFigures figures_at(const std::vector<ThesisFigures>& all, int m);

struct ThesisCase {
  PhongScene scene;
  size_t thesis_triangles = 0;  // as the thesis counts them; 0: it does not say
  bool polished = false;        // also compared with a reference of four rays a reflection
  std::vector<ThesisFigures> figures, polished_figures;
  double thesis_gpu_ms = -1, thesis_cpu_ms = -1;  // its own references by exact rays
  double polished_gpu_ms = -1, polished_cpu_ms = -1;
};

// In the thesis' order. Without the file `bunny` the two scenes with it are made of a torus knot of about as many
// triangles, and their titles say so.
std::vector<ThesisCase> thesis_cases(const std::string& bunny = k_thesis_bunny);

// The objects of the cases.
TriangleMesh thesis_supershape_1(int around = 128, int along = 64);
TriangleMesh thesis_supershape_2(int around = 128, int along = 64);

// One light, one object of `triangles` or somewhat more: a supershape cut ever finer.
PhongScene thesis_growing_scene(size_t triangles);

}  // namespace fieldtrace
