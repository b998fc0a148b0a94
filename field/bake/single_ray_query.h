// Queries of one object's field, one ray at a time, that bake the slices they need: the simple interface. The renderer
// queries in batches (field/query/segment_kernels.h).
//
// Space: object space of the field's shape. Thread-safety: one SingleRayQuery per thread; any number may share a field.
#pragma once

#include <cstdint>
#include <optional>

#include "core/trace/accel.h"
#include "field/bake/bake.h"
#include "field/query/query.hd.h"
#include "field/store/field.h"

namespace fieldtrace {

enum class FieldVerdict {
  clear,     // nothing of the object lies on the segment (or it does not meet the ball)
  blocked,   // something does; of a nearest query: a hit
  undecided  // the field cannot tell: trace a ray. Also if the pool of bricks is full.
};

struct FieldHit {
  FieldVerdict verdict = FieldVerdict::undecided;
  // Of a hit only:
  float t = 0.0f;               // in units of the ray's direction
  float t_error = 0.0f;         // bound on the error of t
  Vec3 normal = Vec3(0.0f);     // of the plane fit, unit, on the side that the ray comes from
  uint32_t primitive = k_none;  // a triangle near the hit: the one that the cell's centre line meets, if any
};

class SingleRayQuery {
 public:
  // `shape` is the field's object in `accel`; field and accel must outlive the query.
  SingleRayQuery(Field& field, const Accel& accel, uint32_t shape);

  // Whether the object meets o + t d, t in [0, t_max]; d need not be unit, t_max may be infinite. `self`: o lies on the
  // object's surface (up to rounding) and d points away from it.
  FieldVerdict occluded(const QueryPolicy& policy, const Vec3& o, const Vec3& d, float t_max, bool self);

  // The object's nearest point on o + t d, t in [t_min, t_max].
  FieldHit nearest(const QueryPolicy& policy, const Vec3& o, const Vec3& d, float t_min, float t_max, bool self);

  const BakeCounters& counters() const { return counters_; }

 private:
  bool bake(std::optional<FieldLayer> layer, uint32_t slice);

  Field& field_;
  const Accel& accel_;
  uint32_t shape_;
  float to_unit_[12];  // from object space
  BakeCounters counters_;
};

}  // namespace fieldtrace
