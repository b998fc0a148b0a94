// Which objects are left to exact rays: a small part of the picture is traced before it, and what each object's field
// answered and left open there is counted.
//
// Blocks of pixels spread evenly over the whole film, whatever the crop window, send the very rays that the picture
// will: first camera samples, all their light samples. So nothing is baked in vain for the fields that stay, and the
// decision rests on counts that neither threads nor the state of a cache change. Thread-safety: a pure function but for
// the fields, which grow by demand.
#pragma once

#include <atomic>

#include "hybrid/fields/left_to_rays.h"
#include "hybrid/render/transport.h"

namespace fieldtrace {

// `context.answerer` must count uses (AnswererSettings::count_uses). `film` is the crop window of the scene's film.
FieldSurvey survey_fields(const TransportContext& context, const Rect& film, int spp, const std::atomic<bool>* stop);

}  // namespace fieldtrace
