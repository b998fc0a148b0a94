#include "gpu/emulated.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

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

void EmulatedRuntime::queue(std::vector<const void*> uses, std::function<void()> run) {
  require(log_->streams > 0);
  work_.push_back({std::move(run), std::move(uses)});
}

void EmulatedRuntime::release(std::map<std::byte*, size_t>& memory, void* address) {
  const auto found = memory.find(static_cast<std::byte*>(address));
  require(found != memory.end());
  if (found == memory.end()) return;
  for (const Work& work : work_) {
    bool used = work.uses.empty();
    for (const void* place : work.uses) used = used || (place >= found->first && place < found->first + found->second);
    require(!used);
  }
  std::memset(found->first, k_garbage, found->second);
  ::operator delete(found->first, std::align_val_t(256));
  memory.erase(found);
}

Status EmulatedRuntime::initialise() {
  const Status status = count();
  return faults_.has_driver ? status : EmulatedFaults::k_no_driver;
}

Status EmulatedRuntime::device_count(int& devices) {
  devices = faults_.devices;
  return count();
}

Status EmulatedRuntime::properties(int, DeviceProperties& properties) {
  properties = {"Emulated GPU", 9, 0, faults_.memory};
  return count();
}

Status EmulatedRuntime::open(int) {
  const Status status = count();
  if (status == k_success) log_->open_devices += 1;
  return status;
}

Status EmulatedRuntime::load_kernels(std::span<const std::byte>) {
  const Status status = count();
  return faults_.has_kernels ? status : EmulatedFaults::k_no_image;
}

Status EmulatedRuntime::create_stream() {
  const Status status = count();
  if (status == k_success) log_->streams += 1;
  return status;
}

// As a driver's, the functions that release do so even where they report what failed before.
Status EmulatedRuntime::destroy_stream() {
  require(work_.empty());
  if (log_->streams > 0) log_->streams -= 1;
  return count_release();
}

Status EmulatedRuntime::close() {
  if (log_->open_devices > 0) log_->open_devices -= 1;
  return count_release();
}

Status EmulatedRuntime::enter() { return count(); }

Status EmulatedRuntime::allocate(size_t bytes, DeviceAddress& address) {
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
  const auto found = memory_.find(bytes_at(address));
  if (found != memory_.end()) log_->bytes -= found->second, log_->allocated -= 1;
  release(memory_, bytes_at(address));
  return count_release();
}

Status EmulatedRuntime::allocate_host(size_t bytes, void*& memory) {
  const Status status = count();
  if (status != k_success) return status;
  memory = make_garbage(bytes);
  host_memory_[static_cast<std::byte*>(memory)] = bytes;
  log_->host_allocated += 1;
  return status;
}

Status EmulatedRuntime::free_host(void* memory) {
  log_->host_allocated -= 1;
  release(host_memory_, memory);
  return count_release();
}

Status EmulatedRuntime::copy_to_device(DeviceAddress to, const void* from, size_t bytes) {
  require(lies_inside(memory_, bytes_at(to), bytes) && lies_inside(host_memory_, from, bytes));
  bytes_waiting_ += bytes;
  queue({bytes_at(to), from}, [=] { std::memcpy(bytes_at(to), from, bytes); });
  return count();
}

Status EmulatedRuntime::copy_to_host(void* to, DeviceAddress from, size_t bytes) {
  require(lies_inside(memory_, bytes_at(from), bytes) && lies_inside(host_memory_, to, bytes));
  log_->bytes_down[int(last_kernel_)] += bytes;
  queue({bytes_at(from), to}, [=] { std::memcpy(to, bytes_at(from), bytes); });
  return count();
}

Status EmulatedRuntime::copy_on_device(DeviceAddress to, DeviceAddress from, size_t bytes) {
  require(lies_inside(memory_, bytes_at(to), bytes) && lies_inside(memory_, bytes_at(from), bytes));
  queue({bytes_at(to), bytes_at(from)}, [=] { std::memcpy(bytes_at(to), bytes_at(from), bytes); });
  return count();
}

Status EmulatedRuntime::fill_zero(DeviceAddress address, size_t bytes) {
  require(lies_inside(memory_, bytes_at(address), bytes));
  queue({bytes_at(address)}, [=] { std::memset(bytes_at(address), 0, bytes); });
  return count();
}

Status EmulatedRuntime::launch(Kernel kernel, uint32_t blocks, const void* arguments, size_t bytes) {
  const Status status = count();
  if (status != k_success) return status;
  const auto* const first = static_cast<const std::byte*>(arguments);
  // Aligned for any structure.
  const auto copy = std::make_shared<std::vector<std::max_align_t>>(bytes / sizeof(std::max_align_t) + 1);
  std::memcpy(copy->data(), first, bytes);
  log_->launches[int(kernel)] += 1;
  if (kernel != Kernel::scatter) {
    log_->bytes_up[int(kernel)] += std::exchange(bytes_waiting_, 0);
    last_kernel_ = kernel;
  }
  queue({}, [=, run = faults_.run_kernel] { run(kernel, blocks, copy->data()); });
  return status;
}

Status EmulatedRuntime::synchronise() {
  if (faults_.at_synchronise) faults_.at_synchronise();
  std::vector<Work> work;
  work.swap(work_);
  log_->synchronisations += 1;
  const Status status = count();
  // A device that fails does nothing more.
  if (status == k_success) {
    for (const Work& w : work) w.run();
  }
  return status;
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
