#include "core/light/light_batch-inl.h"
#include "core/light/light_irradiance_batch-inl.h"

namespace fieldtrace {

void sample_light_scalar(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                         const LightSampleRange& range, ShadowBatch& out) {
  scalar::LightLoop<float>{lights, light, shading_points, range, out}.run();
}

void whole_irradiance_scalar(const Light& light, const ShadingPointBatch& points, float* out) {
  scalar::whole_irradiance_batch<double>(light, points, out);
}

void irradiance_vectors_scalar(const Light& light, const ShadingPointBatch& points, IrradianceVectors& out) {
  scalar::irradiance_vectors_batch<double>(light, points, out);
}

}  // namespace fieldtrace
