#include "core/light/light_irradiance.h"

#include "core/light/light_kernels.h"

namespace fieldtrace {

void whole_irradiance(const Light& light, const ShadingPointBatch& points, Isa isa, AlignedVector<float>& irradiance) {
  irradiance.resize(padded(points.size));
  irradiance_kernel_for(isa)(light, points, irradiance.data());
}

}  // namespace fieldtrace
