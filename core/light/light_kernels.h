// The compiled variants of the loops over lights, one per instruction set. Internal to light_sampling and
// light_irradiance.
// Thread-safety: pure functions.
#pragma once

#include <array>
#include <cstdint>

#include "core/light/light_irradiance.h"
#include "core/light/light_sampling.h"

namespace fieldtrace {

alignas(64) inline constexpr std::array<uint32_t, k_batch_padding> k_iota = {0, 1, 2,  3,  4,  5,  6,  7,
                                                                             8, 9, 10, 11, 12, 13, 14, 15};

// The caller resizes `out`; for a light of kind `none` all slots are inactive already.
using LightKernel = void (*)(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                             const LightSampleRange& range, ShadowBatch& out);

// `isa` must be resolved: supported by this processor, not `automatic`.
LightKernel light_kernel_for(Isa isa);

void sample_light_scalar(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                         const LightSampleRange& range, ShadowBatch& out);

// As whole_irradiance(); `out` has room for the batch and its padding.
using IrradianceKernel = void (*)(const Light& light, const ShadingPointBatch& points, float* out);

// `isa` must be resolved: supported by this processor, not `automatic`.
IrradianceKernel irradiance_kernel_for(Isa isa);

void whole_irradiance_scalar(const Light& light, const ShadingPointBatch& points, float* out);

// As irradiance_vectors(), for lights with a closed form; `out` has the size of the batch and its padding. Where there
// is no vector, x is k_no_vector.
using IrradianceVectorsKernel = void (*)(const Light& light, const ShadingPointBatch& points, IrradianceVectors& out);

// `isa` must be resolved: supported by this processor, not `automatic`.
IrradianceVectorsKernel irradiance_vectors_kernel_for(Isa isa);

void irradiance_vectors_scalar(const Light& light, const ShadingPointBatch& points, IrradianceVectors& out);

}  // namespace fieldtrace
