// The fields of one render in the thesis' chart: one per shape that wants one, each baked completely or read from a
// cache.
//
// They store distances only, for shadow rays. Thread-safety: used by one thread; the finished fields are const.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "field/file/field_cache.h"
#include "field/thesis/thesis_field.h"
#include "hybrid/stats/stats.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// M of the thesis' chart from D and N of RenderOptions; D = 0: not given, M is then 64. Throws UsageError for a D other
// than 32, 64 and 128, and for any N: this chart has no plane.
int thesis_directions(int directions, int plane);

// Throws Error if fields for `objects` objects do not fit in `budget_bytes`.
void require_thesis_memory(size_t objects, int m, uint64_t budget_bytes);

class ThesisFieldSet {
 public:
  // Bakes nothing yet. Throws like require_thesis_memory() for all shapes of `scene` that want a field.
  ThesisFieldSet(const Scene& scene, std::span<const ShapeTraits> traits, int m, uint64_t budget_bytes);

  // Reads what `cache` holds, bakes the rest and stores it there; null: no cache. Returns false if `stop` ended it. A
  // field that cannot be stored is reported to `warning`.
  bool make(const Accel& accel, FieldCache* cache, const ThesisBakeCallbacks& callbacks, const WarningSink& warning,
            Stats& stats);

  bool empty() const { return shapes_.empty(); }
  std::vector<const ThesisField*> pointers() const;  // by shape; null: exact rays
  void count(Stats& stats) const;

 private:
  bool make_field(uint32_t shape, const Accel& accel, FieldCache* cache, const ThesisBakeCallbacks& callbacks,
                  const WarningSink& warning);

  const Scene& scene_;
  int m_;
  std::vector<uint32_t> shapes_;  // that want a field
  std::vector<std::optional<ThesisField>> fields_;
};

}  // namespace fieldtrace
