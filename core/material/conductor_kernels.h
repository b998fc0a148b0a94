// The compiled variants of the loop behind sample_conductor(), one per instruction set. Thread-safety: pure functions.
#pragma once

#include "core/material/conductor_samples.h"

namespace fieldtrace {

// Parameters shared by a batch of samples.
struct ConductorTask {
  const Material& material;
  const Frame& frame;
  Vec3 wi;
  uint32_t seed, first;
  int count;
};

// `out` has room for `count` samples and a batch's padding.
using ConductorKernel = void (*)(const ConductorTask& task, LobeSamples& out);

// `isa` must be resolved: supported by this processor, not `automatic`.
ConductorKernel conductor_kernel_for(Isa isa);

void sample_conductor_scalar(const ConductorTask& task, LobeSamples& out);

}  // namespace fieldtrace
