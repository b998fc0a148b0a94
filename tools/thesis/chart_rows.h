// The thesis' chart beside the orthographic one at no more bytes: error, exact rays and time of shadow look-ups.
//
// Shading points see a ball-shaped light past one object; their visibility, the share of the light's rays that arrive,
// is compared with Embree's answers to the same rays. Two sets of shading points: behind the object, where the
// orthographic chart reads visibility cells alone (a byte each), and on the object itself, where it reads depth cells,
// too (12 bytes each). Bytes are those of complete fields, of what such rays read. The orthographic field is the finest
// that takes no more bytes than the thesis' at the same M; there is none for small M where depth cells count. It is
// baked by demand, which does not change its cells. Times are processor time of one thread with a warm field: the least
// of several runs. Thread-safety: as run_thesis().
#pragma once

#include <string>
#include <vector>

#include "core/trace/accel.h"
#include "field/thesis/thesis_field.h"
#include "tools/thesis/measure.h"

namespace fieldtrace {

// `scene`: of one object, instance 0, which `accel` was built for and `field` baked from. Adds rows: one by the thesis'
// chart and, where a field is small enough, orthographic ones that trace what they ask for exactly, and that trace
// nothing. `title` is theirs.
void compare_charts(const std::string& title, const Scene& scene, const Accel& accel, const ThesisField& field,
                    const ThesisRunOptions& options, std::vector<ThesisChartRow>& rows);

}  // namespace fieldtrace
