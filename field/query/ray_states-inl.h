// Rays of a batch as lanes, and updates of their states by candidates, for the loops of every kind of field.
//
// Included once per Highway target and once for plain floats. Thread-safety: writes the given states only.

#if defined(FIELDTRACE_FIELD_QUERY_RAY_STATES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_RAY_STATES_INL_H_
#undef FIELDTRACE_FIELD_QUERY_RAY_STATES_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_RAY_STATES_INL_H_
#endif

#include "field/query/segment_kernels.h"
#include "field/query/states.hd.h"

FT_LANES_BEGIN

template <class F>
struct RayLanes {
  Vec3Lanes<F> o, d;
  F tmax;
};

template <class F>
FT_HD_INLINE RayLanes<F> load_rays(const RayBatch& r, size_t i) {
  return {{load_lanes<F>(&r.ox[i]), load_lanes<F>(&r.oy[i]), load_lanes<F>(&r.oz[i])},
          {load_lanes<F>(&r.dx[i]), load_lanes<F>(&r.dy[i]), load_lanes<F>(&r.dz[i])},
          load_lanes<F>(&r.tmax[i])};
}

// Adds one candidate's answer to the states of the rays at i: crosses: they meet its bounds; blocked: by it; undecided:
// they need an exact ray.
template <class F>
FT_HD_INLINE void update_states(RayStates& states, size_t i, Mask_t<F> crosses, Mask_t<F> blocked, Mask_t<F> undecided,
                                int32_t candidate_slot) {
  const Int_t<F> state = load_int_lanes<F>(&states.state[i]);
  store_lanes(updated_state<F>(state, crosses, blocked, undecided), &states.state[i]);
  const Int_t<F> undecided_slot = load_int_lanes<F>(&states.undecided_slot[i]);
  store_lanes(select(undecided, splat_int<F>(candidate_slot), undecided_slot), &states.undecided_slot[i]);
}

FT_LANES_END

#endif  // toggled guard
