#include "field/bake/single_ray_query.h"

#include "core/simd/vec_lanes.h"
#include "field/query/nearest.hd.h"

namespace fieldtrace {
namespace {

using scalar::k_verdict_blocked;
using scalar::k_verdict_clear;
using scalar::k_verdict_none;
using scalar::k_verdict_unknown_depth;
using scalar::k_verdict_unknown_visibility;

// The layer whose slice must be baked before the query can be answered; empty: it is answered.
std::optional<FieldLayer> unknown_layer(int verdict) {
  if (verdict == k_verdict_unknown_visibility) return FieldLayer::visibility;
  if (verdict == k_verdict_unknown_depth) return FieldLayer::depth;
  return std::nullopt;
}

FieldVerdict public_verdict(int verdict) {
  if (verdict == k_verdict_clear || verdict == k_verdict_none) return FieldVerdict::clear;
  return verdict == k_verdict_blocked ? FieldVerdict::blocked : FieldVerdict::undecided;
}

}  // namespace

SingleRayQuery::SingleRayQuery(Field& field, const Accel& accel, uint32_t shape)
    : field_(field), accel_(accel), shape_(shape) {
  write_unit_transform(Affine(1.0f), field.ball(), to_unit_);
}

bool SingleRayQuery::bake(std::optional<FieldLayer> layer, uint32_t slice) {
  if (!layer) return false;
  bake_slices(field_, *layer, std::span(&slice, 1), accel_, shape_, counters_);
  return field_.finished(*layer, slice);
}

FieldVerdict SingleRayQuery::occluded(const QueryPolicy& policy, const Vec3& o, const Vec3& d, float t_max, bool self) {
  const auto segment = scalar::segment_in_unit_space(to_unit_, lanes(o), lanes(d), t_max);
  for (;;) {
    const auto answer = scalar::query_segment(field_.view(), policy, segment, self);
    if (!bake(unknown_layer(answer.verdict), uint32_t(answer.slice))) return public_verdict(answer.verdict);
  }
}

FieldHit SingleRayQuery::nearest(const QueryPolicy& policy, const Vec3& o, const Vec3& d, float t_min, float t_max,
                                 bool self) {
  const auto segment = scalar::segment_in_unit_space(to_unit_, lanes(o + d * t_min), lanes(d), t_max - t_min);
  for (;;) {
    const auto answer = scalar::nearest_on_segment(field_.view(), policy, segment, self);
    const bool lacks_primitive = answer.verdict == k_verdict_blocked && answer.primitive == scalar::k_not_baked;
    const auto layer = lacks_primitive ? FieldLayer::primitive : unknown_layer(answer.verdict);
    if (bake(layer, uint32_t(answer.slice))) continue;
    FieldHit hit;
    hit.verdict = public_verdict(answer.verdict);
    if (hit.verdict == FieldVerdict::blocked) {
      hit.t = t_min + answer.distance / segment.scale;
      hit.t_error = answer.error / segment.scale;
      hit.normal = {answer.normal.x, answer.normal.y, answer.normal.z};
      if (answer.primitive >= 0) hit.primitive = uint32_t(answer.primitive);
    }
    return hit;
  }
}

}  // namespace fieldtrace
