// One attempt at a picture, with the fields of a plan.
#pragma once

#include "hybrid/fields/field_set.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// Renders the picture into `result`. Returns false if it is to be tried again: with what `plan` has become, since the
// fields outgrew their memory, or with the accuracy of `stage`, which a survey changed. Called by one thread; rendering
// is parallel.
bool attempt(const Picture& picture, Stage& stage, FieldPlan& plan, RenderResult& result);

}  // namespace fieldtrace
