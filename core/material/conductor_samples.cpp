#include "core/material/conductor_samples.h"

#include "core/material/conductor_batch-inl.h"
#include "core/trace/rays.h"

namespace fieldtrace {

void sample_conductor_scalar(const ConductorTask& task, LobeSamples& out) {
  scalar::sample_conductor_batch<float>(task, out);
}

bool samples_in_lanes(const Material& material) {
  return material.kind == BsdfKind::rough_conductor && material.microfacet.kind == MicrofacetKind::ggx &&
         !material.masked();
}

void sample_conductor(const Material& material, const Frame& frame, const Vec3& wi, uint32_t seed, uint32_t first,
                      int count, Isa isa, LobeSamples& out) {
  for (auto* v : {&out.dx, &out.dy, &out.dz, &out.red, &out.green, &out.blue, &out.pdf})
    v->resize(padded(size_t(count)));
  conductor_kernel_for(resolve_isa(isa))({material, frame, wi, seed, first, count}, out);
}

}  // namespace fieldtrace
