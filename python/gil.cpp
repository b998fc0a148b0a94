#include "gil.h"

#include <cxxabi.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace nb = nanobind;

namespace fieldtrace::python {
namespace {

struct Calls {
  std::mutex mutex;
  std::condition_variable changed;
  size_t under_way = 0;
  std::thread::id ending_thread;  // whose later calls go on as ever; before `ending` is set
  std::atomic<bool> ending = false;

  bool has_ended_for_this_thread() const { return ending && std::this_thread::get_id() != ending_thread; }
};

// Never destroyed: threads may wait beside it until the process is gone.
Calls& calls() {
  static Calls& all = *new Calls;
  return all;
}

[[noreturn]] void wait_for_exit() {
  for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
}

void end_calls() {
  Calls& c = calls();
  PyThreadState* const state = PyEval_SaveThread();
  {
    std::unique_lock lock(c.mutex);
    c.ending_thread = std::this_thread::get_id();
    c.ending = true;
    c.changed.wait(lock, [&] { return c.under_way == 0; });
  }
  PyEval_RestoreThread(state);
}

}  // namespace

bool is_ending() { return calls().ending; }

GilReleased::GilReleased() : state_(PyEval_SaveThread()) {
  Calls& c = calls();
  std::unique_lock lock(c.mutex);
  if (c.has_ended_for_this_thread()) {
    lock.unlock();
    wait_for_exit();
  }
  is_late_ = c.ending;
  ++c.under_way;
}

GilReleased::~GilReleased() {
  Calls& c = calls();
  {
    const std::lock_guard lock(c.mutex);
    --c.under_way;
    c.changed.notify_all();
  }
  if (c.has_ended_for_this_thread()) wait_for_exit();
  take_back();
}

// What Python unwinds stops here.
void GilReleased::take_back() {
  try {
    PyEval_RestoreThread(state_);
  } catch (const abi::__forced_unwind&) {
    wait_for_exit();
  }
}

void wait_for_calls_at_exit() { nb::module_::import_("atexit").attr("register")(nb::cpp_function(&end_calls)); }

}  // namespace fieldtrace::python
