#include "long_call.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <system_error>
#include <thread>

#include "gil.h"

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
  bool is_late = false;  // begun when the program was ending

  bool should_end() const { return cancelled || (!is_late && is_ending()); }
};

int on_progress(void* user, double share) {
  Work& work = *static_cast<Work*>(user);
  work.share = share;
  return !work.should_end();
}

// Runs signal handlers, and tells `progress` of `share` if it is not yet told. With the GIL. Throws nb::python_error.
void tell(const nb::object& progress, double share, double& told) {
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
  if (share <= told || progress.is_none()) return;
  told = share;
  progress(share);
}

// Runs `function` until it ends, whatever becomes of the thread that called.
class Worker {
 public:
  Worker(Work& work, std::function<void()> function)
      : work_(work), thread_([this, f = std::move(function)] { run(f); }) {}
  ~Worker() {
    work_.cancelled = true;
    thread_.join();
  }
  // False if it goes on after `time`.
  bool ends_within(std::chrono::milliseconds time) {
    std::unique_lock lock(work_.mutex);
    return work_.changed.wait_for(lock, time, [&] { return work_.done; });
  }

 private:
  void run(const std::function<void()>& function) {
    try {
      function();
    } catch (...) {
      work_.error = std::current_exception();
    }
    const std::lock_guard lock(work_.mutex);
    work_.done = true;
    work_.changed.notify_one();
  }

  Work& work_;
  std::thread thread_;
};

}  // namespace

void LongCalls::run(FTDevice device, const nb::object& progress, const std::function<void()>& function) {
  Work work;
  std::exception_ptr raised;
  double told = 0.0;
  {
    GilReleased released;
    work.is_late = released.is_late();
    const auto tell_share = [&](double share) {
      if (raised || (!work.is_late && is_ending())) return;
      try {
        released.with_gil([&] { tell(progress, share, told); });
      } catch (...) {
        raised = std::current_exception();
        work.cancelled = true;
      }
    };
    try {
      Worker worker(work, [&] {
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
      });
      while (!worker.ends_within(k_poll)) tell_share(work.share);
    } catch (const std::system_error&) {  // no thread to spare
      raised = std::current_exception();
    }
    if (!work.error) tell_share(1.0);
  }
  // A cancelled call reports that it was; why comes first.
  if (raised) std::rethrow_exception(raised);
  if (work.error) std::rethrow_exception(work.error);
}

}  // namespace fieldtrace::python
