// Calls of the library without the GIL, that outlive the interpreter.
//
// When the interpreter ends, Python unwinds other threads that ask for the GIL, through frames that cannot be unwound,
// and the system takes the library apart under threads that still work in it: either aborts the process. So calls under
// way are waited for when the program ends, and their threads stay where they are from then on. Thread-safety: all.
#pragma once

#include <nanobind/nanobind.h>

namespace fieldtrace::python {

// The GIL is given away while this lives, which is within one call of the library.
class GilReleased {
 public:
  GilReleased();
  ~GilReleased();
  GilReleased(const GilReleased&) = delete;
  GilReleased& operator=(const GilReleased&) = delete;

  // Whether the program was ending already.
  bool is_late() const { return is_late_; }
  // Calls f() with the GIL. Throws what it throws.
  template <class F>
  void with_gil(const F& f) {
    take_back();
    try {
      f();
    } catch (...) {
      state_ = PyEval_SaveThread();
      throw;
    }
    state_ = PyEval_SaveThread();
  }

 private:
  void take_back();

  PyThreadState* state_;
  bool is_late_ = false;
};

// Whether the program ends, and calls that were under way before should, too.
bool is_ending();

// Has Python call, when it ends, what waits for the calls under way.
void wait_for_calls_at_exit();

}  // namespace fieldtrace::python
