// The loops of the parity test for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/field/chart_parity_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "field/query/nearest.hd.h"
#include "tests/support/chart_parity.h"

#if HWY_TARGET != HWY_SCALAR
FT_LANES_BEGIN

inline F32 lanes_at(const AlignedVector<float>& v, size_t i) { return load(&v[i]); }

// The scalar loop of chart_parity_test.cpp, one vector at a time.
void trace_parity(const FieldView& field, const QueryPolicy& policy, const RayBatch& rays, bool self,
                  ParityResults& out) {
  for (size_t i = 0; i < rays.size; i += size_t(Lanes<F32>::k_count)) {
    const Vec3Lanes<F32> o = {lanes_at(rays.ox, i), lanes_at(rays.oy, i), lanes_at(rays.oz, i)};
    const Vec3Lanes<F32> d = {lanes_at(rays.dx, i), lanes_at(rays.dy, i), lanes_at(rays.dz, i)};
    const auto s = segment_in_unit_space(k_parity_transform, o, d, lanes_at(rays.tmax, i));
    const auto at = address_of_line(s.direction, s.foot, field.directions, field.plane);
    store(at.u, &out.u[i]);
    store(at.v, &out.v[i]);
    store(at.a, &out.a[i]);
    store(at.b, &out.b[i]);
    const MaskLanes is_own = self ? s.crosses : and_not(s.crosses, s.crosses);
    const auto segment = query_segment(field, policy, s, is_own);
    store(segment.verdict, &out.verdict[i]);
    store(select(segment.verdict > splat_int<F32>(k_verdict_undecided), segment.slice, splat_int<F32>(0)),
          &out.slice[i]);
    const auto nearest = nearest_on_segment(field, policy, s, is_own);
    store(nearest.verdict, &out.nearest[i]);
    store(nearest.distance, &out.distance[i]);
  }
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

ParityTrace parity_trace(Isa isa) { FT_RETURN_FORM_FOR(isa, trace_parity, nullptr) }

}  // namespace fieldtrace
#endif
