#include "field/file/keep.h"

#include <new>

namespace fieldtrace {

void keep(const std::string& object, IfUnkept if_unkept, const WarningSink& warning,
          const std::function<void()>& store) {
  const auto say = [&](const std::string& reason) {
    const std::string message = reason + "; not kept: " + object;
    if (if_unkept == IfUnkept::fail) throw Error(message);
    warn(warning, {}, message);
  };
  try {
    store();
  } catch (const Error& e) {
    say(e.what());
  } catch (const std::bad_alloc&) {
    say("there is not enough memory");
  }
}

}  // namespace fieldtrace
