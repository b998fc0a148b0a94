// The thesis' chart against the orthographic one at no more bytes: error, exact rays and time of shadow look-ups.
//
// Shading points see a spherical light past one object; their visibility, the share of the light's rays that arrive, is
// compared with Embree's answers to the same rays. There are two sets of shading points: behind the object, where the
// orthographic chart reads visibility cells only (one byte each), and on the object itself, where it also reads depth
// cells (12 bytes each). Bytes are those of the layers that such rays read, in complete fields. The orthographic field
// is the finest that takes no more bytes than the thesis' at the same M; for small M there is none where depth cells
// count. It is baked on demand, which does not change its cells. Times are processor time of one thread with a warm
// field, the least of several runs. Thread-safety: as run_thesis().
#pragma once

#include <string>
#include <vector>

#include "core/trace/accel.h"
#include "field/thesis/thesis_field.h"
#include "tools/thesis/measure.h"

namespace fieldtrace {

// `scene` has one object, instance 0; `accel` was built for it and `field` baked from it. Adds a row for the thesis'
// chart and, where a field is small enough, rows for orthographic ones that trace undecided rays exactly and for ones
// that trace nothing. `title` is that of the rows.
void compare_charts(const std::string& title, const Scene& scene, const Accel& accel, const ThesisField& field,
                    const ThesisRunOptions& options, std::vector<ThesisChartRow>& rows);

}  // namespace fieldtrace
