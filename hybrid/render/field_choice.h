// Which objects' fields a picture uses, decided by surveys of a few of its pixels.
#pragma once

#include "hybrid/fields/field_set.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// The settings where `fields` answer shadow rays of bundles; without any, those of Monte Carlo.
TransportSettings settings_for(const Picture& picture, const FieldSet& fields, float tolerance);

// Finds how many light samples a camera sample takes where lights may be hidden. Returns false if it was stopped.
bool choose_light_samples(const Picture& picture, Stage& stage, int& open_samples, Stats& stats);

// Leaves to exact rays the objects that too few light samples pass for what their fields cost, before anything is baked
// or read; a camera sample takes `open_samples` where lights may be hidden. Returns false if it was stopped.
bool leave_unpaid(const Picture& picture, const Stage& stage, FieldSet& fields, int open_samples, Stats& stats);

// Leaves shadows of objects on themselves to exact rays where their fields are undecided. Returns false if it was
// stopped.
bool leave_undecided(const Picture& picture, const Stage& stage, FieldSet& fields, float tolerance, Stats& stats);

}  // namespace fieldtrace
