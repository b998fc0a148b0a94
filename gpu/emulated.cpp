#include "gpu/emulated.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "gpu/device_arguments.h"

namespace fieldtrace::gpu {
namespace {

constexpr int k_garbage = 0xcd;

std::byte* bytes_at(DeviceAddress address) { return std::bit_cast<std::byte*>(address); }

std::byte* make_garbage(size_t bytes) {
  auto* const memory = static_cast<std::byte*>(::operator new(bytes, std::align_val_t(256)));
  std::memset(memory, k_garbage, bytes);
  return memory;
}

}  // namespace

// What a driver does when its process ends; the log keeps what should have been released before.
EmulatedRuntime::~EmulatedRuntime() {
  uint64_t ignored = 0;
  for (auto* memory : {&memory_, &host_memory_}) drop(*memory, ignored);
}

void EmulatedRuntime::drop(std::map<std::byte*, size_t>& memory, uint64_t& live) {
  for (const auto& [address, bytes] : memory) {
    ::operator delete(address, std::align_val_t(256));
    live -= 1;
  }
  memory.clear();
}

Status EmulatedRuntime::count() {
  const uint64_t call = log_->calls++;
  const bool fails = faults_.lost ? call >= faults_.failing_call : call == faults_.failing_call;
  return fails ? faults_.failure : k_success;
}

Status EmulatedRuntime::count_release() {
  log_->releases += 1;
  return count();
}

void EmulatedRuntime::require(bool right) { log_->misuse += !right; }

bool EmulatedRuntime::lies_inside(const std::map<std::byte*, size_t>& memory, const void* from, size_t bytes) const {
  auto* const begin = static_cast<std::byte*>(const_cast<void*>(from));
  auto after = memory.upper_bound(begin);
  if (after == memory.begin()) return false;
  --after;
  return begin + bytes <= after->first + after->second;
}

void EmulatedRuntime::queue(Stream stream, std::vector<const void*> uses, std::function<void()> run) {
  require(log_->streams > 0);
  Queue& q = queues_[stream];
  if (q.failure != k_success) {  // what it would use has not been done
    ++q.begun;
    return;
  }
  q.work.push_back({std::move(run), std::move(uses)});
}

void EmulatedRuntime::run_until(Stream stream, uint64_t end) {
  Queue& q = queues_[stream];
  while (q.begun < end && !q.work.empty()) {
    const Work work = std::move(q.work.front());
    q.work.pop_front();
    ++q.begun;
    work.run();
  }
}

void EmulatedRuntime::release(std::map<std::byte*, size_t>& memory, void* address) {
  const auto found = memory.find(static_cast<std::byte*>(address));
  require(found != memory.end());
  if (found == memory.end()) return;
  for (const Queue& q : queues_) {
    for (const Work& work : q.work) {
      for (const void* place : work.uses) require(place < found->first || place >= found->first + found->second);
    }
  }
  std::memset(found->first, k_garbage, found->second);
  ::operator delete(found->first, std::align_val_t(256));
  memory.erase(found);
}

Status EmulatedRuntime::list(std::vector<DeviceProperties>& devices) {
  const std::lock_guard lock(mutex_);
  const Status status = count();
  if (!faults_.has_driver) return EmulatedFaults::k_no_driver;
  devices.assign(size_t(faults_.devices), {"Emulated GPU", 9, 0, faults_.memory});
  return status;
}

// Each of its steps may fail, so that what the ones before have opened is left to be closed.
Status EmulatedRuntime::open(int, std::span<const std::byte>) {
  const std::lock_guard lock(mutex_);
  Status status = count();
  if (status == k_success) log_->open_devices += 1;
  if (status == k_success) status = count();
  if (status == k_success && !faults_.has_kernels) status = EmulatedFaults::k_no_image;
  if (status == k_success) status = count();
  if (status == k_success) log_->streams += k_streams;
  return status;
}

// As a driver's, the functions that release do so even where they report what failed before.
Status EmulatedRuntime::close() {
  const std::lock_guard lock(mutex_);
  for (const Queue& q : queues_) require(q.work.empty());
  require(memory_.empty() && host_memory_.empty());
  log_->streams = 0;
  if (log_->open_devices > 0) log_->open_devices -= 1;
  return count_release();
}

Status EmulatedRuntime::enter() {
  const std::lock_guard lock(mutex_);
  return count();
}

Status EmulatedRuntime::allocate(size_t bytes, DeviceAddress& address) {
  const std::lock_guard lock(mutex_);
  const Status status = count();
  if (status != k_success) return status;
  if (log_->bytes + bytes > faults_.memory) return EmulatedFaults::k_out_of_memory;
  std::byte* const memory = make_garbage(bytes);
  memory_[memory] = bytes;
  address = reinterpret_cast<DeviceAddress>(memory);
  log_->allocated += 1;
  log_->bytes += bytes;
  log_->peak_bytes = std::max(log_->peak_bytes, log_->bytes);
  return status;
}

Status EmulatedRuntime::free(DeviceAddress address) {
  const std::lock_guard lock(mutex_);
  const auto found = memory_.find(bytes_at(address));
  if (found != memory_.end()) log_->bytes -= found->second, log_->allocated -= 1;
  release(memory_, bytes_at(address));
  return count_release();
}

Status EmulatedRuntime::allocate_host(size_t bytes, void*& memory) {
  const std::lock_guard lock(mutex_);
  const Status status = count();
  if (status != k_success) return status;
  memory = make_garbage(bytes);
  host_memory_[static_cast<std::byte*>(memory)] = bytes;
  log_->host_allocated += 1;
  return status;
}

Status EmulatedRuntime::free_host(void* memory) {
  const std::lock_guard lock(mutex_);
  log_->host_allocated -= 1;
  release(host_memory_, memory);
  return count_release();
}

Status EmulatedRuntime::copy_to_device(Stream stream, DeviceAddress to, const void* from, size_t bytes) {
  const std::lock_guard lock(mutex_);
  require(lies_inside(memory_, bytes_at(to), bytes) && lies_inside(host_memory_, from, bytes));
  queues_[stream].bytes_waiting += bytes;
  queue(stream, {bytes_at(to), from}, [=] { std::memcpy(bytes_at(to), from, bytes); });
  return count();
}

Status EmulatedRuntime::copy_to_host(Stream stream, void* to, DeviceAddress from, size_t bytes) {
  const std::lock_guard lock(mutex_);
  require(lies_inside(memory_, bytes_at(from), bytes) && lies_inside(host_memory_, to, bytes));
  log_->bytes_down[int(queues_[stream].last_kernel)] += bytes;
  queue(stream, {bytes_at(from), to}, [=] { std::memcpy(to, bytes_at(from), bytes); });
  return count();
}

Status EmulatedRuntime::copy_on_device(Stream stream, DeviceAddress to, DeviceAddress from, size_t bytes) {
  const std::lock_guard lock(mutex_);
  require(lies_inside(memory_, bytes_at(to), bytes) && lies_inside(memory_, bytes_at(from), bytes));
  queue(stream, {bytes_at(to), bytes_at(from)}, [=] { std::memcpy(bytes_at(to), bytes_at(from), bytes); });
  return count();
}

Status EmulatedRuntime::fill_zero(Stream stream, DeviceAddress address, size_t bytes) {
  const std::lock_guard lock(mutex_);
  require(lies_inside(memory_, bytes_at(address), bytes));
  queue(stream, {bytes_at(address)}, [=] { std::memset(bytes_at(address), 0, bytes); });
  return count();
}

Status EmulatedRuntime::launch(Stream stream, Kernel kernel, uint32_t blocks, const void* arguments, size_t bytes) {
  const std::lock_guard lock(mutex_);
  const Status status = count();
  if (status != k_success) return status;
  // Aligned for any structure.
  const auto copy = std::make_shared<std::vector<std::max_align_t>>(bytes / sizeof(std::max_align_t) + 1);
  std::memcpy(copy->data(), arguments, bytes);
  log_->launches[int(kernel)] += 1;
  Queue& q = queues_[stream];
  if (kernel != Kernel::scatter && kernel != Kernel::light_rays) {
    log_->bytes_up[int(kernel)] += std::exchange(q.bytes_waiting, 0);
    q.last_kernel = kernel;
  }
  // It uses what its arguments point to.
  std::vector<const void*> uses;
  for (size_t at = 0; at + sizeof(void*) <= bytes; at += sizeof(void*)) {
    const void* place = nullptr;
    std::memcpy(&place, static_cast<const std::byte*>(arguments) + at, sizeof place);
    if (lies_inside(memory_, place, 1)) uses.push_back(place);
  }
  queue(stream, std::move(uses), [=, this] { run_kernel(kernel, blocks, copy->data()); });
  return status;
}

void EmulatedRuntime::run_kernel(Kernel kernel, uint32_t blocks, const void* arguments) {
  if (kernel == Kernel::scatter) {
    const auto& a = *static_cast<const ScatterArguments*>(arguments);
    for (uint32_t i = 0; i < a.warps; ++i) {
      require(lies_inside(memory_, bytes_at(a.runs[i].to), a.runs[i].words * sizeof(uint32_t)));
    }
  }
  faults_.run_kernel(kernel, blocks, arguments);
}

Status EmulatedRuntime::follow(Stream stream, Stream other) {
  const std::lock_guard lock(mutex_);
  const uint64_t end = queues_[other].begun + queues_[other].work.size();
  queue(stream, {}, [=, this] { run_until(other, end); });
  return count();
}

Status EmulatedRuntime::synchronise(Stream stream) {
  if (faults_.at_synchronise) faults_.at_synchronise();
  const std::lock_guard lock(mutex_);
  log_->synchronisations += 1;
  const Status status = count();
  const Status failure = std::exchange(queues_[stream].failure, k_success);
  // As CUDA's failures of work: every stream's work is lost, and what comes later is too until the stream has said so,
  // since it may need what was lost.
  if (status != k_success) {
    for (Queue& q : queues_) {
      if (&q != &queues_[stream]) q.failure = status;
      q.begun += q.work.size();
      q.work.clear();
    }
    return status;
  }
  const auto run_all = [&](Stream s) { run_until(s, queues_[s].begun + queues_[s].work.size()); };
  for (Stream s = 0; faults_.eager && s < k_streams; ++s) {
    if (s != stream) run_all(s);
  }
  run_all(stream);
  return failure;
}

std::string EmulatedRuntime::describe(Status status) const {
  switch (status) {
    case EmulatedFaults::k_out_of_memory:
      return "out of memory";
    case EmulatedFaults::k_no_driver:
      return "no driver";
    case EmulatedFaults::k_no_image:
      return "no kernel image for this device";
    default:
      return "failure " + std::to_string(status);
  }
}

}  // namespace fieldtrace::gpu
