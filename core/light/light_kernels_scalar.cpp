#include "core/light/light_batch-inl.h"

namespace fieldtrace {

void sample_light_scalar(const LightTable& lights, uint32_t light, const ReceiverBatch& receivers,
                         const LightSampleRange& range, ShadowBatch& out) {
  scalar::LightLoop<float>{lights, light, receivers, range, out}.run();
}

}  // namespace fieldtrace
