// Which objects' fields a picture uses, decided by surveys of a few of its pixels.
#pragma once

#include "hybrid/fields/field_set.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// The settings where `fields` answer shadow rays of bundles; without any, those of Monte Carlo.
TransportSettings settings_for(const Picture& picture, const FieldSet& fields, float tolerance);

// Where lights may be hidden.
struct OpenLight {
  int samples = 1;                    // light samples of each camera sample
  ShadowRays rays = {k_infinity, 0};  // infinite: not surveyed
};

// Leaves to exact rays the objects that too few light samples pass for what their fields cost, before anything is baked
// or read. Returns false if it was stopped.
// `open` becomes what exact rays alone would have.
bool leave_unpaid(const Picture& picture, const Stage& stage, FieldSet& fields, OpenLight& open, Stats& stats);

// Leaves to exact rays what fields answer too little of, or all if that costs more than it spares; `open`, that of
// exact rays, becomes what remains with fields. Returns false if it was stopped.
bool leave_to_rays(const Picture& picture, const Stage& stage, FieldSet& fields, float tolerance, OpenLight& open,
                   Stats& stats);

}  // namespace fieldtrace
