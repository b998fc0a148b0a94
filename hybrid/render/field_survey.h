// Surveys a small part of the picture before it is rendered, to count what each object's field answers and leaves
// undecided; the counts decide which objects are left to exact rays.
//
// Blocks of pixels spread evenly over the whole film, whatever the crop window, send about the rays that the picture
// will send: those of the first camera samples, with as many light samples as all of a pixel's have. So nothing is
// baked in vain for the fields that are kept, and the decision rests on counts that depend neither on threads nor on
// the state of a cache.
// Thread-safety: a pure function but for the fields, which grow on demand.
#pragma once

#include <functional>

#include "hybrid/fields/field_set.h"
#include "hybrid/transport/transport.h"

namespace fieldtrace {

// Interrupted once goes_on() is false. `context.answerer` must count uses (AnswererSettings::count_uses). `film`: the
// film's crop window. `repeats`: light samples of a pixel of the picture per one of the survey.
FieldSurvey survey_fields(const TransportContext& context, const Rect& film, double repeats,
                          const std::function<bool()>& goes_on);

}  // namespace fieldtrace
