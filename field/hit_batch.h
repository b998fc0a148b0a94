// What a field says of a batch of rays about the nearest surface of its object, and what it lacks to say so.
//
// Memory layout: structures of arrays, padded like RayBatch. Thread-safety: values.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/rays.h"

namespace fieldtrace {

// Of one object, in world space; t in units of the rays' directions. What lies beyond a ray's limit is not told.
struct HitAnswers {
  AlignedVector<int32_t> verdict;    // k_verdict_none, _clear, _ask or _blocked: a hit (field/query.hd.h)
  AlignedVector<float> entry;        // where the ray enters the object's ball; unspecified for none
  AlignedVector<float> t, error;     // of a hit, and the bound on its error
  AlignedVector<float> bend;         // of a hit: that error bound, taken along the normal, in half widths of its cell
  AlignedVector<float> nx, ny, nz;   // of a hit: unit normal of its sheet, on the side that the ray comes from
  AlignedVector<int32_t> primitive;  // of a hit: a triangle near it; -1: none is known

  void resize(size_t n) {
    for (auto* v : {&entry, &t, &error, &bend, &nx, &ny, &nz}) v->resize(padded(n));
    for (auto* v : {&verdict, &primitive}) v->resize(padded(n));
  }
};

// Blocks of k_batch_padding rays that met cells which are not baked, as their first index, and the slices to bake.
struct HitUnknowns {
  std::vector<uint32_t> blocks, visibility, depth, primitive;
  std::array<std::vector<uint32_t>*, 3> lists() { return {&visibility, &depth, &primitive}; }
};

}  // namespace fieldtrace
