// What the parity test compares between the scalar code and the vector loops of tests/field/chart_parity_kernels.cpp.
//
// Memory layout: arrays padded like RayBatch. Thread-safety: values and pure functions.
#pragma once

#include <cstdint>

#include "core/simd/isa.h"
#include "core/trace/rays.h"
#include "field/store/view.h"

namespace fieldtrace {

struct ParityResults {
  explicit ParityResults(size_t n) {
    for (auto* p : {&u, &v, &a, &b, &verdict, &slice, &nearest}) p->resize(padded(n));
    distance.resize(padded(n));
  }
  AlignedVector<int32_t> u, v, a, b;      // cell of the line
  AlignedVector<int32_t> verdict, slice;  // of the segment query; slice: the one to bake, or 0
  AlignedVector<int32_t> nearest;         // verdict of the nearest query
  AlignedVector<float> distance;          // of its hit
};

// The identity: rays are given in unit space.
inline constexpr float k_parity_transform[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

// Addresses, segment queries and nearest queries of a batch; `self`: the rays leave the object itself.
using ParityTrace = void (*)(const FieldView& field, const QueryPolicy& policy, const RayBatch& rays, bool self,
                             ParityResults& out);

// Null for Isa::scalar and instruction sets that were not compiled.
ParityTrace parity_trace(Isa isa);

}  // namespace fieldtrace
