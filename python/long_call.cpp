#include "long_call.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <thread>

namespace nb = nanobind;

namespace fieldtrace::python {
namespace {

// How long a Ctrl-C waits at most, beside the library's own way to its next progress report.
constexpr std::chrono::milliseconds k_poll{50};

// What the two threads share.
struct Work {
  std::mutex mutex;
  std::condition_variable changed;
  bool done = false;
  std::exception_ptr error;
  std::atomic<double> share = 0.0;
  std::atomic<bool> cancelled = false;
};

int on_progress(void* user, double share) {
  Work& work = *static_cast<Work*>(user);
  work.share = share;
  return !work.cancelled;
}

// Runs signal handlers, and tells `progress` of `share` if it is not yet told. Throws nb::python_error.
void tell(const nb::object& progress, double share, double& told) {
  const nb::gil_scoped_acquire acquired;
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
  if (share <= told || progress.is_none()) return;
  told = share;
  progress(share);
}

}  // namespace

void LongCalls::run(FTDevice device, const nb::object& progress, const std::function<void()>& function) {
  Work work;
  std::exception_ptr raised;
  double told = 0.0;
  const auto tell_share = [&](double share) {
    try {
      tell(progress, share, told);
    } catch (...) {
      raised = std::current_exception();
      work.cancelled = true;
    }
  };
  {
    const nb::gil_scoped_release released;
    std::thread worker([&] {
      try {
        const std::lock_guard alone(one_at_a_time_);
        ft::check(ftSetDeviceProgressCallback(device, on_progress, &work), device);
        std::exception_ptr error;
        try {
          if (!work.cancelled) function();
        } catch (...) {
          error = std::current_exception();
        }
        ftSetDeviceProgressCallback(device, nullptr, nullptr);
        if (error) std::rethrow_exception(error);
      } catch (...) {
        work.error = std::current_exception();
      }
      const std::lock_guard lock(work.mutex);
      work.done = true;
      work.changed.notify_one();
    });
    std::unique_lock lock(work.mutex);
    while (!work.changed.wait_for(lock, k_poll, [&] { return work.done; })) {
      lock.unlock();
      if (!raised) tell_share(work.share);
      lock.lock();
    }
    lock.unlock();
    worker.join();
    if (!raised && !work.error) tell_share(1.0);
  }
  // A cancelled call reports that it was; why comes first.
  if (raised) std::rethrow_exception(raised);
  if (work.error) std::rethrow_exception(work.error);
}

}  // namespace fieldtrace::python
