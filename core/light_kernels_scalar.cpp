#include "core/light_batch-inl.h"

namespace fieldtrace {

void sample_light_scalar(const LightTable& lights, uint32_t light, const ReceiverBatch& receivers, int light_samples,
                         ShadowBatch& out) {
  scalar::LightLoop<float>{lights, light, receivers, light_samples, out}.run();
}

}  // namespace fieldtrace
