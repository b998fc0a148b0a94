// Batches of nearest-hit queries to one field: the rays, the answers, and what must be baked before there are answers.
//
// Memory layout: structures of arrays, padded like RayBatch. Thread-safety: values.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/trace/rays.h"

namespace fieldtrace {

// World space. Rays are unit and infinite; those with tmax < 0 are inactive.
struct HitQueries {
  RayBatch rays;
  AlignedVector<uint32_t> instance;  // that the ray leaves
  AlignedVector<float> limit;        // hits beyond this distance do not matter
  AlignedVector<float> most_error;   // of a hit's distance, relative to the distance
  AlignedVector<float> most_bend;    // tangent of about how much its normal may differ from the surface's

  void resize(size_t n) {
    rays.resize(n);
    instance.assign(padded(n), 0xffffffffu);
    for (auto* v : {&limit, &most_error, &most_bend}) v->assign(padded(n), 0.0f);
  }
};

// Of one object, in world space.
struct HitAnswers {
  AlignedVector<int32_t> verdict;    // k_verdict_none: nothing within the limit; _clear; _undecided; _blocked: a hit
  AlignedVector<float> from;         // of undecided rays and hits: no part of the object is nearer than this
  AlignedVector<float> t, error;     // of a hit, and the bound on its error
  AlignedVector<float> nx, ny, nz;   // of a hit: unit normal of its plane fit, on the side that the ray comes from
  AlignedVector<int32_t> primitive;  // of a hit: a triangle near it

  void resize(size_t n) {
    for (auto* v : {&from, &t, &error, &nx, &ny, &nz}) v->resize(padded(n));
    for (auto* v : {&verdict, &primitive}) v->resize(padded(n));
  }
};

// Blocks of k_batch_padding rays that met cells which are not baked, by their first index, and the slices to bake.
struct HitUnknowns {
  std::vector<uint32_t> blocks, visibility, depth, primitive;
  std::array<std::vector<uint32_t>*, 3> lists() { return {&visibility, &depth, &primitive}; }
};

}  // namespace fieldtrace
