// What a candidate's answer makes of the state of a ray (RayStates, field/query/segment_kernels.h) and of the flag of a
// shading point: for the CPU's loops, and for the merge of a device's masks.
//
// Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_QUERY_STATES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_STATES_HD_H_
#undef FIELDTRACE_FIELD_QUERY_STATES_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_STATES_HD_H_
#endif

#include "core/simd/lanes.hd.h"
#include "field/query/query_tasks.h"

FT_LANES_BEGIN

// crosses: the ray meets the candidate's bounds; blocked: by it; undecided: it needs an exact ray.
template <class F>
FT_HD_INLINE Int_t<F> updated_state(Int_t<F> state, Mask_t<F> crosses, Mask_t<F> blocked, Mask_t<F> undecided) {
  const Int_t<F> zero = splat_int<F>(0);
  state = state | select(crosses, splat_int<F>(RayStateBits::k_crosses), zero);
  state = state | select(blocked, splat_int<F>(RayStateBits::k_blocked), zero);
  return state + select(undecided, splat_int<F>(RayStateBits::k_undecided), zero);
}

// Rays that no candidate blocks, by how many leave them undecided.
template <class F>
struct UndecidedRays {
  Mask_t<F> by_one, by_more;
};
template <class F>
FT_HD_INLINE UndecidedRays<F> undecided_rays(Int_t<F> state) {
  const Int_t<F> blocked = splat_int<F>(RayStateBits::k_blocked), once = splat_int<F>(RayStateBits::k_undecided);
  const Mask_t<F> is_blocked = (state & blocked) == blocked;
  const Int_t<F> undecided = state & splat_int<F>(~(RayStateBits::k_undecided - 1));
  return {and_not(is_blocked, undecided == once), and_not(is_blocked, undecided > once)};
}

// clear, blocked: the whole light, by the candidate; by_strata: where neither is certain, strata can be tried.
template <class F>
FT_HD_INLINE Int_t<F> updated_flag(Int_t<F> flag, Mask_t<F> clear, Mask_t<F> blocked, Mask_t<F> by_strata) {
  const Int_t<F> open = select(by_strata, flag | splat_int<F>(k_by_strata), flag);
  return select(clear, splat_int<F>(0), select(blocked, splat_int<F>(k_light_blocked), open));
}

FT_LANES_END

#endif  // toggled guard
