#include "gpu/device.h"

#include <algorithm>

#include "gpu/device_questions.h"

namespace fieldtrace::gpu {

GpuDevice::GpuDevice(std::unique_ptr<Runtime> runtime, std::span<const std::byte> kernels, const DeviceOptions& options)
    : runtime_(std::move(runtime)), cpu_(options.kernels), warning_(options.warning) {
  Runtime& r = *runtime_;
  check(r, r.initialise(), "starting CUDA");
  int count = 0;
  check(r, r.device_count(count), "counting CUDA devices");
  if (count == 0) throw Error("this machine has no CUDA device");
  DeviceProperties properties;
  check(r, r.properties(0, properties), "asking for the device's properties");
  is_open_ = true;
  try {
    check(r, r.open(0), ("opening " + properties.name).c_str());
    check(r, r.load_kernels(kernels), ("loading the kernels into " + properties.name).c_str());
    check(r, r.create_stream(), "making a stream");
    memory_.emplace(r, options.memory ? options.memory : properties.memory);
    wave_.emplace(*memory_);
  } catch (...) {
    release();
    throw;
  }
}

GpuDevice::~GpuDevice() {
  say_warnings();
  release();
}

void GpuDevice::say_warnings() {
  for (const std::string& warning : warnings_) warn(warning_, {}, warning);
  warnings_.clear();
}

void GpuDevice::release() {
  if (!is_open_) return;
  is_open_ = false;
  // What fails here has failed before, or hurts nobody.
  (void)runtime_->enter();
  (void)runtime_->synchronise();
  mirrors_.clear();
  retired_.clear();
  retired_mirrors_.clear();
  wave_.reset();
  (void)runtime_->destroy_stream();
  (void)runtime_->close();
}

void GpuDevice::lose(const std::string& why) {
  release();
  {
    const std::lock_guard lock(mutex_);
    is_lost_ = true;
  }
  try {
    warnings_.push_back("the GPU is not used any more: " + why + "; the CPU answers instead");
  } catch (const std::bad_alloc&) {
    // Without memory for its warning the picture is still finished.
  }
}

void GpuDevice::ask(Question& question) {
  if (question.blocks.empty()) return;
  std::unique_lock lock(mutex_);
  if (is_lost_) {
    counts_.blocks_cpu += question.blocks.size();
    return;
  }
  waiting_.push_back(&question);
  while (!question.is_done) {
    if (runs_) {
      changed_.wait(lock);
      continue;
    }
    runs_ = true;
    std::vector<Question*> wave;
    wave.swap(waiting_);
    lock.unlock();
    run(wave);
    lock.lock();
    for (Question* q : wave) {
      q->is_done = true;
      size_t left = q->is_answered ? 0 : q->blocks.size();
      for (size_t warp = 0; q->is_answered && warp < q->blocks.size(); ++warp) left += q->not_baked(warp);
      counts_.blocks += q->blocks.size() - left;
      counts_.blocks_cpu += left;
    }
    counts_.waves += 1;
    if (memory_) {
      counts_.bytes_resident = memory_->used();
      counts_.bytes_peak = memory_->peak();
    }
    runs_ = false;
    changed_.notify_all();
  }
}

void GpuDevice::run(std::span<Question* const> questions) {
  if (!is_open_) return;
  try {
    run_wave(questions);
  } catch (const std::exception& e) {
    lose(e.what());
  }
}

void GpuDevice::leave_out(const Field& field, const std::string& why) {
  const FieldParameters& p = field.parameters();
  warnings_.push_back("a field of " + std::to_string(p.directions) + " x " + std::to_string(p.plane) +
                      " cells does not fit into the GPU's memory (" + why + "); the CPU answers for its object");
  std::unique_ptr<FieldMirror>& mirror = mirrors_[&field];
  if (mirror) retired_mirrors_.push_back(std::move(mirror));
  mirror = nullptr;
}

// Once for each field of a wave: what a mirror has put into the packet stays where it is until the packet is spread.
void GpuDevice::stage_mirror(const Field& field) {
  const auto [found, is_new] = mirrors_.try_emplace(&field);
  const Packet& packet = wave_->packet;
  const size_t words = packet.words.size(), runs = packet.runs.size();
  try {
    if (is_new) found->second = std::make_unique<FieldMirror>(field, *memory_, retired_);
    if (found->second) found->second->stage(wave_->packet);
  } catch (const OutOfDeviceMemory& e) {
    wave_->packet.words.resize(words);
    wave_->packet.runs.resize(runs);
    leave_out(field, e.what());
  }
}

// Copies all that is staged to the device, and starts the kernels.
void GpuDevice::start(std::span<Question* const> questions) {
  Wave& wave = *wave_;
  const Packet& packet = wave.packet;
  const size_t runs = wave.in.append(packet.runs.data(), packet.runs.size() * sizeof(ScatterRun));
  const size_t words = wave.in.append(packet.words.data(), packet.words.size() * sizeof(uint32_t));
  for (StagingBuffer* buffer : {&wave.in, &wave.out, &wave.missing}) buffer->ensure_device();
  wave.in.copy_to_device();
  if (!packet.runs.empty()) {
    const ScatterArguments arguments = {wave.in.device<const ScatterRun>(runs), wave.in.device<const uint32_t>(words),
                                        uint32_t(packet.runs.size())};
    check(*runtime_, runtime_->launch(Kernel::scatter, arguments.warps, &arguments, sizeof arguments),
          "starting the kernel scatter");
  }
  for (const Question* q : questions) {
    if (q->mirror) check(*runtime_, q->launch(*runtime_, q->mirror->view(), wave), "starting a kernel");
  }
  wave.out.copy_to_host();
}

void GpuDevice::run_wave(std::span<Question* const> questions) {
  Runtime& r = *runtime_;
  Wave& wave = *wave_;
  check(r, r.enter(), "choosing the device");
  for (StagingBuffer* buffer : {&wave.in, &wave.out, &wave.missing}) buffer->clear();
  wave.packet.words.clear();
  wave.packet.runs.clear();
  std::set<const Field*> staged;
  size_t asked = 0;
  for (Question* q : questions) {
    if (staged.insert(&q->field).second) stage_mirror(q->field);
    q->mirror = mirrors_[&q->field].get();
    if (!q->mirror) continue;
    ++asked;
    q->stage(wave.in, wave.out);
    q->missing = wave.missing.reserve(q->blocks.size() * k_missing_words * sizeof(uint32_t));
  }
  if (asked > 0) start(questions);
  check(r, r.synchronise(), "waiting for the GPU");
  retired_.clear();
  retired_mirrors_.clear();
  if (asked > 0) collect(questions);
}

void GpuDevice::collect(std::span<Question* const> questions) {
  bool any_missing = false;
  for (Question* q : questions) {
    if (!q->mirror) continue;
    q->take_answers(wave_->out);
    q->is_answered = true;
    for (size_t warp = 0; warp < q->blocks.size(); ++warp) any_missing = any_missing || q->not_baked(warp);
  }
  if (!any_missing) return;
  wave_->missing.copy_to_host();
  check(*runtime_, runtime_->synchronise(), "waiting for the GPU");
  for (const Question* q : questions) {
    if (!q->mirror) continue;
    for (size_t warp = 0; warp < q->blocks.size(); ++warp) {
      if (!q->not_baked(warp)) continue;
      const size_t at = q->missing + warp * k_missing_words * sizeof(uint32_t);
      q->mirror->want({wave_->missing.host<const uint32_t>(at), k_missing_words});
    }
  }
}

void GpuDevice::forget_fields() {
  say_warnings();
  const std::lock_guard lock(mutex_);
  if (!is_open_) return;
  (void)runtime_->enter();  // the next wave reports a failure
  mirrors_.clear();
  counts_.bytes_resident = memory_->used();
}

size_t GpuDevice::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

DeviceCounts GpuDevice::counts() const {
  const std::lock_guard lock(mutex_);
  return counts_;
}

std::vector<std::string> list_devices(Runtime& runtime) {
  try {
    check(runtime, runtime.initialise(), "starting CUDA");
    int count = 0;
    check(runtime, runtime.device_count(count), "counting CUDA devices");
    if (count == 0) return {"none: this machine has no CUDA device"};
    std::vector<std::string> lines;
    for (int i = 0; i < count; ++i) {
      DeviceProperties p;
      check(runtime, runtime.properties(i, p), "asking for the device's properties");
      lines.push_back(std::to_string(i) + ": " + p.name + ", compute capability " + std::to_string(p.compute_major) +
                      "." + std::to_string(p.compute_minor) + ", " + std::to_string(p.memory / 1000000) + " MB");
    }
    return lines;
  } catch (const Error& e) {
    return {std::string("none: ") + e.what()};
  }
}

}  // namespace fieldtrace::gpu
