// Keeping what was baked, where a picture does not depend on it.
#pragma once

#include <functional>
#include <string>

#include "core/platform/error.h"

namespace fieldtrace {

// What becomes of what a cache cannot keep: a warning, as it must not cost a finished picture, or an error.
enum class IfUnkept { warn, fail };

// Calls `store`, which keeps `object`, "the field of the bunny", in a cache. Where that cannot be, warns or throws
// Error.
void keep(const std::string& object, IfUnkept if_unkept, const WarningSink& warning,
          const std::function<void()>& store);

}  // namespace fieldtrace
