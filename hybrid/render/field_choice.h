// Which objects' fields a picture uses, decided by surveys of a few of its pixels.
#pragma once

#include "hybrid/fields/field_set.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// The settings where `fields` answer shadow rays of bundles; without any, those of Monte Carlo.
TransportSettings settings_for(const Picture& picture, const FieldSet& fields, float tolerance);

// Leaves to exact rays the objects that too few light samples pass for what their fields cost, before anything is baked
// or read. Returns false if it was stopped.
// `open_samples` becomes the number of light samples that exact rays alone would get where lights may be hidden.
bool leave_unpaid(const Picture& picture, const Stage& stage, FieldSet& fields, int& open_samples, Stats& stats);

// Leaves to exact rays what fields answer too little of; `open_samples` becomes what remains with them. Returns false
// if it was stopped.
bool leave_to_rays(const Picture& picture, const Stage& stage, FieldSet& fields, float tolerance, int& open_samples,
                   Stats& stats);

}  // namespace fieldtrace
