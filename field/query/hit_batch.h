// What a field is asked about the nearest surface of its object along rays, what it says, and what it lacks to say so.
//
// Memory layout: structures of arrays, padded like RayBatch. Thread-safety: values.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/trace/rays.h"

namespace fieldtrace {

// World space; rays are unit and endless, those with tmax < 0 inactive.
struct HitQueries {
  RayBatch rays;
  AlignedVector<uint32_t> instance;  // that the ray leaves
  AlignedVector<float> limit;        // what lies beyond this distance does not matter
  AlignedVector<float> most_error;   // of a hit's distance, for each unit of the distance
  AlignedVector<float> most_bend;    // by which its normal may differ from the surface's, about: a tangent

  void resize(size_t n) {
    rays.resize(n);
    instance.assign(padded(n), 0xffffffffu);
    for (auto* v : {&limit, &most_error, &most_bend}) v->assign(padded(n), 0.0f);
  }
};

// Of one object, in world space.
struct HitAnswers {
  AlignedVector<int32_t> verdict;    // k_verdict_none (nothing within the limit), _clear, _ask or _blocked: a hit
  AlignedVector<float> from;         // of ask and hits: nothing of the object lies before this distance
  AlignedVector<float> t, error;     // of a hit, and the bound on its error
  AlignedVector<float> nx, ny, nz;   // of a hit: unit normal of its plane fit, on the side that the ray comes from
  AlignedVector<int32_t> primitive;  // of a hit: a triangle near it

  void resize(size_t n) {
    for (auto* v : {&from, &t, &error, &nx, &ny, &nz}) v->resize(padded(n));
    for (auto* v : {&verdict, &primitive}) v->resize(padded(n));
  }
};

// Blocks of k_batch_padding rays that met cells which are not baked, as their first index, and the slices to bake.
struct HitUnknowns {
  std::vector<uint32_t> blocks, visibility, depth, primitive;
  std::array<std::vector<uint32_t>*, 3> lists() { return {&visibility, &depth, &primitive}; }
};

}  // namespace fieldtrace
