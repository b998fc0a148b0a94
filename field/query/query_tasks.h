// What is asked of one candidate object: its field, and how the way to its unit space is.
//
// Plain data without pointers to anything but fields, so that devices take it as it is. Thread-safety: values.
#pragma once

#include <cstdint>

#include "field/store/view.h"

namespace fieldtrace {

// One candidate object for a batch of rays.
struct SegmentTask {
  FieldView field;
  QueryPolicy policy;
  float to_unit[12];             // world -> unit space of the object, 3 x 4, column-major
  float to_unit_stretch = 0.0f;  // bound on the length of to_unit's image of a unit vector
  float to_unit_area = 0.0f;     // bound on the area of to_unit's image of a unit square
  bool keeps_angles = false;     // to_unit is a similarity, up to rounding
  uint32_t instance = 0;         // rays from shading points on this instance are self-shadowing
  bool self_only = false;        // other rays are undecided
  bool reads_depth = true;       // false: what the visibility cell does not decide stays undecided
};

// An object without a field: its bounds decide which rays must be traced.
struct BoxTask {
  float to_object[12];  // world -> object space, 3 x 4, column-major
  float to_object_stretch = 0.0f;
  float lower[3], upper[3];  // object space
  uint32_t instance = 0;
  bool skip_self = false;  // flat objects cannot block rays that leave them
};

// Of a ray's state: the candidates' answers about it so far.
struct RayStateBits {
  static constexpr int32_t k_crosses = 1;    // meets some candidate's bounds
  static constexpr int32_t k_blocked = 2;    // by some candidate
  static constexpr int32_t k_undecided = 4;  // added once for each candidate that needs an exact ray
};

// Bits of a shading point's flag: what stands between it and a light.
inline constexpr int32_t k_may_shadow = 1;     // some object may shadow it: single rays must decide
inline constexpr int32_t k_light_blocked = 2;  // the whole light is hidden
inline constexpr int32_t k_by_strata = 4;      // the object can answer by strata (field/query/stratum.hd.h)

// One candidate object tested against whole lights (field/query/cone.hd.h).
struct ConeTask {
  SegmentTask segment;
  float from_unit[9];      // unit space -> world, linear part, column-major
  float half_extent[3];    // of the object's bounds, a box about the origin of unit space
  int plane_fit_side = 0;  // directions a side tried for shading points on the object; 0: these stay open
};

// One candidate object tested against strata of lights (field/query/stratum.hd.h).
struct StratumTask {
  SegmentTask segment;
  float share = 1.0f;       // of one stratum in the light's samples: 1 / number of strata
  float least_disc = 0.5f;  // strata whose half width at the blocker, in texels, is smaller are refused;
                            // divided by the policy's slack
};

}  // namespace fieldtrace
