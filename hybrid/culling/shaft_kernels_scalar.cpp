#include "hybrid/culling/shaft_batch-inl.h"

namespace fieldtrace {

void keep_met_by_shafts_scalar(const ShaftTask& task, const ShadingPointBatch& points, int32_t* flags) {
  scalar::keep_met_by_shafts<double>(task, points, flags);
}

}  // namespace fieldtrace
