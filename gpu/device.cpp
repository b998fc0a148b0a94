#include "gpu/device.h"

#include <algorithm>
#include <type_traits>

#include "hybrid/visibility/query_and_bake.h"

namespace fieldtrace::gpu {

GpuDevice::GpuDevice(std::unique_ptr<Runtime> runtime, std::span<const std::byte> kernels, const DeviceOptions& options)
    : runtime_(std::move(runtime)), warning_(options.warning) {
  Runtime& r = *runtime_;
  std::vector<DeviceProperties> devices;
  check(r, r.list(devices), "looking for CUDA devices");
  if (devices.empty()) throw Error("this machine has no CUDA device");
  is_open_ = true;
  try {
    check(r, r.open(0, kernels), ("opening " + devices[0].name).c_str());
    memory_.emplace(r, options.memory ? options.memory : devices[0].memory);
    for (Stream s = 0; s < k_streams; ++s) waves_.push_back(std::make_unique<Wave>(*memory_, s, tables_));
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

// No wave may be busy.
void GpuDevice::release() {
  if (!is_open_) return;
  is_open_ = false;
  // What fails here has failed before, or hurts nobody.
  (void)runtime_->enter();
  for (Stream s = 0; s < k_streams; ++s) (void)runtime_->synchronise(s);
  mirrors_.clear();
  waves_.clear();
  tables_.buffers.clear();
  (void)runtime_->close();
}

void GpuDevice::lose(const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (is_lost_) return;
  is_lost_ = true;
  try {
    warnings_.push_back("the GPU is not used any more: " + why + "; the CPU answers instead");
  } catch (const std::bad_alloc&) {
    // Without memory for its warning the picture is still finished.
  }
}

template <class Work>
bool GpuDevice::attempt(const Work& work) {
  try {
    work();
    return true;
  } catch (const std::exception& e) {
    lose(e.what());
    return false;
  }
}

namespace {

MirrorSource source_of(const DeviceQuestion& question) { return *question.field; }
MirrorSource source_of(const LobeQuestion& question) { return {*question.tiles, question.task.segment.field}; }

template <class Question>
bool has_answer(const Question& q, size_t block) {
  return q.is_answered && q.masks[block].not_baked == 0;
}

void add_items(const DeviceWave& wave, std::vector<Item>& items) {
  const auto add = [&](auto* question) {
    Item item{question, source_of(*question), {}, question->is_answered ? 0 : question->samples};
    for (uint32_t b = 0; b < question->blocks.size(); ++b) {
      if (!has_answer(*question, b)) item.warps.push_back(b);
    }
    item.answered_before = question->blocks.size() - item.warps.size();
    question->unbaked = {};
    if (!item.warps.empty()) items.push_back(std::move(item));
  };
  for (ConeQuestion* q : wave.cones) add(q);
  for (StratumQuestion* q : wave.strata) add(q);
  for (RayQuestion* q : wave.rays) add(q);
  for (LobeQuestion* q : wave.lobes) add(q);
  for (SkyQuestion* q : wave.skies) {
    const size_t tasks = q->tasks->tasks().size();
    if (q->points.size == 0 || tasks == 0) continue;
    Item item{q, {}, {}, uint64_t(q->points.size) * tasks};
    item.warps.resize(size_t(q->points.size) / k_warp);
    items.push_back(std::move(item));
  }
}

// Blocks that have been answered.
size_t answered_blocks(const Item& item) {
  return std::visit(
      [](const auto* q) -> size_t {
        if constexpr (std::is_same_v<decltype(q), const SkyQuestion*>) {
          return q->is_answered ? size_t(q->points.size) / k_warp : 0;
        } else {
          size_t answered = 0;
          for (size_t b = 0; b < q->blocks.size(); ++b) answered += has_answer(*q, b);
          return answered;
        }
      },
      item.question);
}

bool was_asked(const Item& item) {
  return std::visit([](const auto* q) { return q->is_answered; }, item.question);
}

// Names what a block met that is not baked.
void name_unbaked(Item& item, std::span<const uint32_t> words) {
  std::visit(
      [&](auto* q) {
        if constexpr (std::is_base_of_v<DeviceQuestion, std::remove_pointer_t<decltype(q)>>) {
          std::vector<uint32_t>* const lists[] = {&q->unbaked.visibility, &q->unbaked.depth, &q->unbaked.tiles};
          for (const uint32_t word : words) {
            if (word != k_nothing) lists[int(missing_kind(word))]->push_back(missing_number(word));
          }
        }
      },
      item.question);
}

}  // namespace

void GpuDevice::answer(const DeviceWave& wave) {
  Request request;
  add_items(wave, request.items);
  uint64_t first_asked = 0, answered = 0, answered_again = 0;
  std::vector<uint8_t> is_again;
  for (const Item& item : request.items) {
    is_again.push_back(was_asked(item));
    if (!is_again.back()) first_asked += item.warps.size();
  }
  // Once more for what was finished but not resident; as often as fields are asked again after bakes.
  std::vector<Item> all = request.items;
  for (int round = 0; !request.items.empty() && round <= k_most_bake_rounds; ++round) {
    request.is_taken = request.is_done = false;
    ask(request);
    std::erase_if(request.items, [](const Item& item) { return item.warps.empty(); });
  }
  for (size_t i = 0; i < all.size(); ++i) {
    (is_again[i] ? answered_again : answered) += answered_blocks(all[i]) - all[i].answered_before;
  }
  const std::lock_guard lock(mutex_);
  counts_.blocks += answered + answered_again;
  counts_.blocks_cpu += first_asked - answered;
  counts_.blocks_cpu -= answered_again;
}

void GpuDevice::ask(Request& request) {
  Lock lock(mutex_);
  if (is_lost_) {
    for (Item& item : request.items) item.warps.clear();
    return;
  }
  waiting_.push_back(&request);
  while (!request.is_done) {
    Wave* const wave = is_used_ || request.is_taken ? nullptr : free_wave();
    if (wave) {
      run(lock, *wave);
    } else {
      changed_.wait(lock);
    }
  }
}

// Any if the device is lost and released: then there are none, and nobody waits.
GpuDevice::Wave* GpuDevice::free_wave() {
  for (int i = 1; i <= int(waves_.size()); ++i) {
    const int w = (last_wave_ + i) % int(waves_.size());
    if (waves_[size_t(w)]->is_busy) continue;
    last_wave_ = w;
    return waves_[size_t(w)].get();
  }
  return nullptr;
}

void GpuDevice::run(Lock& lock, Wave& wave) {
  std::vector<Request*> requests;
  requests.swap(waiting_);
  uint64_t samples = 0;
  for (Request* r : requests) {
    r->is_taken = true;
    for (Item& item : r->items) samples += std::exchange(item.samples, 0);
  }
  std::vector<Item*> items;
  wave.is_busy = is_used_ = true;
  const bool was_lost = is_lost_;
  const auto give_back = [&] {
    lock.lock();
    is_used_ = false;
    changed_.notify_all();
  };
  lock.unlock();
  bool is_right = !was_lost && attempt([&] {
    for (Request* r : requests) {
      for (Item& item : r->items) items.push_back(&item);
    }
    submit(wave, items);
  });
  give_back();
  lock.unlock();
  is_right = is_right && attempt([&] { collect(wave, items); });
  lock.lock();
  changed_.wait(lock, [&] { return !is_used_; });
  is_used_ = true;
  lock.unlock();
  for (Request* r : requests) {
    for (Item& item : r->items) item.warps.clear();
  }
  // Of a failed wave everything stays until no other is busy, which may use it.
  if (is_right) attempt([&] { tidy(wave, items); });
  const uint64_t used = memory_->used(), peak = memory_->peak();
  give_back();
  wave.is_busy = false;
  for (Request* r : requests) r->is_done = true;
  counts_.waves += 1;
  counts_.samples += samples;
  counts_.waves_full += samples >= k_wave_samples;
  counts_.bytes_resident = used;
  counts_.bytes_peak = peak;
  if (!is_lost_) return;
  for (const auto& other : waves_) {
    if (other->is_busy) return;
  }
  // The last one out; requests that wait are left to the CPU.
  for (Request* r : waiting_) {
    r->is_done = true;
    for (Item& item : r->items) item.warps.clear();
  }
  waiting_.clear();
  release();
}

void GpuDevice::leave_out(Wave& wave, const MirrorSource& source, const std::string& why) {
  std::string what = "an object's radiance maps do";
  if (source.field) {
    const FieldParameters& p = source.field->parameters();
    what = "a field of " + std::to_string(p.directions) + " x " + std::to_string(p.plane) + " cells does";
  }
  std::unique_ptr<FieldMirror>& mirror = mirrors_[source.tiles];
  if (mirror) wave.left_out.push_back(std::move(mirror));
  mirror = nullptr;
  const std::lock_guard lock(mutex_);
  warnings_.push_back(what + " not fit into the GPU's memory (" + why + "); the CPU answers for its object");
}

// Once for each source of a wave: what a mirror has put into the packet stays where it is until the packet is spread.
void GpuDevice::stage_mirror(Wave& wave, const MirrorSource& source) {
  const auto [found, is_new] = mirrors_.try_emplace(source.tiles);
  Packet& packet = wave.packet;
  const size_t words = packet.words.size(), runs = packet.runs.size();
  try {
    if (is_new) found->second = std::make_unique<FieldMirror>(source, *memory_);
    if (found->second) found->second->stage(packet, wave.stream);
  } catch (const OutOfDeviceMemory& e) {
    packet.words.resize(words);
    packet.runs.resize(runs);
    leave_out(wave, source, e.what());
  }
}

void GpuDevice::update_mirrors(Wave& wave, Items items) {
  std::set<const CoverageTiles*> staged;
  for (Item* item : items) {
    const CoverageTiles* const tiles = item->source.tiles;
    if (!tiles || !item->is_asked) continue;
    if (staged.insert(tiles).second) stage_mirror(wave, item->source);
    item->is_asked = mirrors_[tiles] != nullptr;
  }
  const Packet& packet = wave.packet;
  if (packet.runs.empty()) return;
  const size_t runs = wave.fields.append(packet.runs.data(), packet.runs.size() * sizeof(ScatterRun));
  const size_t words = wave.fields.append(packet.words.data(), packet.words.size() * sizeof(uint32_t));
  wave.fields.ensure_device();
  wave.fields.copy_to_device(wave.stream);
  const ScatterArguments arguments = {wave.fields.device<const ScatterRun>(runs),
                                      wave.fields.device<const uint32_t>(words), uint32_t(packet.runs.size())};
  start_kernel(*runtime_, wave, Kernel::scatter, arguments);
}

// Whether the tables of a question are on the device, or come with the wave.
bool GpuDevice::has_tables(Wave& wave, const Item& item) {
  std::vector<HostTable> tables;
  list_tables(item, tables);
  bool has_all = true;
  for (const HostTable& t : tables) {
    const auto [found, is_new] = tables_.buffers.try_emplace(t.host);
    if (is_new) {
      try {
        // The place in the wave first: a table that has memory is taken for there by later waves.
        const size_t at = wave.in.append(t.host, t.bytes);
        // A word more: reads of bytes are of four.
        DeviceBuffer table(*memory_, t.bytes + sizeof(uint32_t));
        wave.new_tables.push_back({at, table.address(), t.bytes});
        found->second = std::move(table);
      } catch (const OutOfDeviceMemory& e) {
        const std::lock_guard lock(mutex_);
        warnings_.push_back("a table of " + std::to_string(t.bytes / 1000) +
                            " kB does not fit into the GPU's memory (" + e.what() + "); the CPU answers what needs it");
      }
    }
    has_all = has_all && found->second.bytes() > 0;
  }
  return has_all;
}

// Copies the questions to the device while the other stream's wave runs, then starts the kernels after that one's.
void GpuDevice::submit(Wave& wave, Items items) {
  Runtime& r = *runtime_;
  check(r, r.enter(), "choosing the device");
  for (StagingBuffer* buffer : {&wave.in, &wave.fields, &wave.made, &wave.out, &wave.missing}) buffer->clear();
  wave.packet.words.clear();
  wave.packet.runs.clear();
  wave.new_tables.clear();
  wave.launches.clear();
  for (Item* item : items) {
    const auto found = mirrors_.find(item->source.tiles);
    item->is_asked = (found == mirrors_.end() || found->second) && has_tables(wave, *item);
    item->unbaked.clear();
  }
  wave.launches.add(items, wave);
  for (StagingBuffer* buffer : {&wave.in, &wave.made, &wave.out, &wave.missing}) buffer->ensure_device();
  for (const auto& launch : wave.launches.all()) launch->settle(wave);
  wave.in.copy_to_device(wave.stream);
  for (Stream other = 0; other < k_streams; ++other) {
    if (other != wave.stream) check(r, r.follow(wave.stream, other), "ordering streams");
  }
  for (const Wave::NewTable& t : wave.new_tables) {
    const DeviceAddress from = std::bit_cast<DeviceAddress>(wave.in.device<std::byte>(t.at));
    check(r, r.copy_on_device(wave.stream, t.to, from, t.bytes), "copying on the device");
  }
  update_mirrors(wave, items);
  wave.rays.start(r, wave.stream, wave.in, wave.made, wave.receivers, tables_);
  for (const auto& launch : wave.launches.all()) {
    const FieldMirror* const mirror = launch->tiles ? mirrors_[launch->tiles].get() : nullptr;
    launch->is_started = mirror || !launch->tiles;
    if (launch->is_started) launch->start(r, mirror ? mirror->view() : FieldView{}, wave);
  }
  wave.out.copy_to_host(wave.stream);
}

void GpuDevice::collect(Wave& wave, Items items) {
  check(*runtime_, runtime_->synchronise(wave.stream), "waiting for the GPU");
  for (const auto& launch : wave.launches.all()) {
    if (launch->is_started) launch->take_answers(wave);
  }
  if (std::all_of(items.begin(), items.end(), [](const Item* item) { return item->unbaked.empty(); })) return;
  wave.missing.copy_to_host(wave.stream);
  check(*runtime_, runtime_->synchronise(wave.stream), "waiting for the GPU");
}

// Remembers what was missing, leaves to ask again what is finished by now, and releases what no stream uses any more:
// later waves have other pools, and those before are done, since this one followed them.
void GpuDevice::tidy(Wave& wave, Items items) {
  wave.packet.outgrown.clear();
  wave.left_out.clear();
  for (Item* item : items) {
    const auto mirror = mirrors_.find(item->source.tiles);
    if (mirror == mirrors_.end() || !mirror->second) continue;
    for (const Item::Unbaked& block : item->unbaked) {
      const std::span words(wave.missing.host<const uint32_t>(block.words), k_missing_words);
      if (mirror->second->want(words)) {
        item->warps.push_back(block.warp);
      } else {
        name_unbaked(*item, words);
      }
    }
  }
}

void GpuDevice::forget_fields() {
  say_warnings();
  const std::lock_guard lock(mutex_);
  if (!is_open_) return;
  (void)runtime_->enter();  // the next wave reports a failure
  mirrors_.clear();
  tables_.buffers.clear();
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
    std::vector<DeviceProperties> devices;
    check(runtime, runtime.list(devices), "looking for CUDA devices");
    if (devices.empty()) return {"none: this machine has no CUDA device"};
    std::vector<std::string> lines;
    for (const DeviceProperties& p : devices) {
      lines.push_back(std::to_string(lines.size()) + ": " + p.name + ", compute capability " +
                      std::to_string(p.compute_major) + "." + std::to_string(p.compute_minor) + ", " +
                      std::to_string(p.memory / 1000000) + " MB");
    }
    return lines;
  } catch (const Error& e) {
    return {std::string("none: ") + e.what()};
  }
}

}  // namespace fieldtrace::gpu
