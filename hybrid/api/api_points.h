// Points on surfaces that a caller of the C interface asks about. Thread-safety: values and pure functions.
#pragma once

#include "core/light/shading_points.h"
#include "hybrid/api/api_buffers.h"
#include "hybrid/api/scene_object.h"

namespace fieldtrace::api {

// Points of a task.
inline constexpr size_t k_points_of_chunk = 256;

struct PointBuffers {
  Buffer<const float, 3> points, normals;
  Buffer<const uint32_t> from;
  size_t count() const { return points.count(); }
  uint32_t instance_of(size_t i) const { return from ? *from.at(i) : k_none; }
};

// Throws Failure unless all points are finite, normals unit, and instances there.
void require_points(const SceneObject& s, const PointBuffers& p);

// Makes point i the shading point j.
void set_point(const PointBuffers& from, size_t i, ShadingPointBatch& to, size_t j);

}  // namespace fieldtrace::api
