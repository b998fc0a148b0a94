#include "gpu/device_mirror.h"

#include <algorithm>

#include "core/platform/shared_value.h"

namespace fieldtrace::gpu {
namespace {

constexpr uint32_t k_slice_words = scalar::k_slice_cells;  // of depth and of certificates
constexpr uint32_t k_visibility_words = scalar::k_slice_cells / sizeof(uint32_t);
constexpr size_t k_first_items = 64;
constexpr size_t k_word = sizeof(uint32_t);

bool is_tile(uint32_t word) { return missing_kind(word) == MissingKind::tile; }
FieldLayer layer_of(uint32_t word) {
  return missing_kind(word) == MissingKind::visibility ? FieldLayer::visibility : FieldLayer::depth;
}

}  // namespace

void Packet::add(DeviceAddress to, const void* from, uint32_t count) {
  runs.push_back({to, uint32_t(words.size()), count});
  words.resize(words.size() + count);
  std::memcpy(words.data() + words.size() - count, from, count * k_word);
}

FieldMirror::FieldMirror(const MirrorSource& source, DeviceMemory& memory) : source_(source), memory_(memory) {
  const FieldView& v = source_.view;
  top_.resize(size_t(v.direction_bricks) * size_t(v.direction_bricks));
  pages_.resize(size_t(v.plane_bricks));
  tile_of_.resize(source_.tiles->slot_count());
  resident_.resize(1);
  page_pool_.item_bytes = size_t(v.plane_bricks) * k_word;
}

void FieldMirror::make_pools(const Growth& growth) {
  grow(tile_table_, tile_of_.size(), growth);
  grow(sums_, k_first_items, growth);
  if (source_.view.coverage.radiance) grow(radiance_, k_first_items, growth);
  if (!source_.field) return;
  grow(top_pool_, top_.size(), growth);
  grow(page_pool_, 1, growth);
  for (Pool* pool : {&visibility_, &depth_, &certificate_}) grow(*pool, k_first_items, growth);
}

void FieldMirror::grow(Pool& pool, size_t items, const Growth& growth) {
  if (items <= pool.capacity) return;
  const bool is_first = pool.capacity == 0;
  pool.capacity = std::max(2 * pool.capacity, items);
  // Both stay owned whatever fails, since streams use them.
  growth.outgrown.push_back(
      std::exchange(pool.buffer, DeviceBuffer(memory_, pool.capacity * pool.item_bytes + k_word)));
  Runtime& runtime = memory_.runtime();
  const DeviceAddress to = pool.buffer.address();
  check(runtime, runtime.fill_zero(growth.stream, to, pool.buffer.bytes()), "clearing device memory");
  const DeviceBuffer& old = growth.outgrown.back();
  if (is_first) return;
  check(runtime, runtime.copy_on_device(growth.stream, to, old.address(), old.bytes()), "copying on the device");
}

bool FieldMirror::want(std::span<const uint32_t> words) {
  bool any = false;
  for (const uint32_t word : words) {
    if (word == k_nothing) continue;
    wanted_.push_back(word);
    any = any || take(word);
  }
  return any;
}

// Whether what the word names is finished and not here yet.
bool FieldMirror::take(uint32_t word) {
  const uint32_t number = missing_number(word);
  if (is_tile(word)) return source_.tiles->finished(number) && tile_of_[number] == 0;
  return source_.field && source_.field->finished(layer_of(word), number);
}

// Makes it if need be.
uint32_t FieldMirror::brick_of_slice(uint32_t slice) {
  const size_t plane_bricks = size_t(source_.view.plane_bricks);
  const size_t direction_brick = slice / plane_bricks / 16, plane_brick = slice % plane_bricks;
  int32_t& page = top_[direction_brick];
  if (page == 0) {
    page = page_count_++;
    pages_.resize(size_t(page_count_) * plane_bricks);
    changes_.push_back({&top_pool_, direction_brick, page});
  }
  const size_t index = size_t(page) * plane_bricks + plane_brick;
  if (pages_[index] == 0) {
    pages_[index] = int32_t(resident_.size());
    resident_.push_back(0);
    changes_.push_back({&page_pool_, index, pages_[index]});
  }
  return uint32_t(pages_[index]);
}

void FieldMirror::add_slice(uint32_t word, Packet& packet) {
  const FieldView& from = source_.view;
  const uint32_t slice = missing_number(word), plane_bricks = uint32_t(from.plane_bricks);
  const uint32_t direction = slice / plane_bricks, plane_brick = slice % plane_bricks;
  const FieldLayer layer = layer_of(word);
  const uint32_t brick = brick_of_slice(slice);
  const uint32_t bit = 1u << (direction % 16 + 16 * uint32_t(layer));
  if (resident_[brick] & bit) return;
  resident_[brick] |= bit;
  const size_t in_brick = (direction % 16) * uint32_t(scalar::k_slice_cells);
  const size_t source = size_t(source_.field->brick_at(direction / 16, plane_brick)) * scalar::k_brick_cells + in_brick;
  const size_t target = size_t(brick) * scalar::k_brick_cells + in_brick;
  if (layer == FieldLayer::visibility) {
    packet.add(visibility_.buffer.address() + target, from.visibility + source, k_visibility_words);
  } else {
    packet.add(depth_.buffer.address() + target * k_word, from.depth + source, k_slice_words);
    packet.add(certificate_.buffer.address() + target * k_word, from.certificate + source, k_slice_words);
  }
}

void FieldMirror::add_tile(uint32_t slot, Packet& packet) {
  const CoverageView& from = source_.view.coverage;
  const int32_t tile = shared(from.tile_of[slot]).load(std::memory_order_acquire);
  const bool is_stored = tile >= int32_t(CoverageTiles::k_fixed_tiles);
  tile_of_[slot] = is_stored ? tile_count_++ : tile;
  if (is_stored) {
    packet.add(sums_.buffer.address() + size_t(tile_of_[slot]) * CoverageTiles::k_tile_bytes,
               from.sums + size_t(tile) * scalar::k_tile_words, uint32_t(scalar::k_tile_words));
  }
  if (is_stored && from.radiance) {
    packet.add(radiance_.buffer.address() + size_t(tile_of_[slot]) * CoverageTiles::k_radiance_bytes,
               from.radiance + size_t(tile) * 3 * scalar::k_tile_words, 3 * uint32_t(scalar::k_tile_words));
  }
  changes_.push_back({&tile_table_, slot, tile_of_[slot]});
}

void FieldMirror::stage(Packet& packet, Stream stream) {
  const Growth growth = {packet.outgrown, stream};
  if (tile_table_.capacity == 0) make_pools(growth);
  std::sort(wanted_.begin(), wanted_.end());
  wanted_.erase(std::unique(wanted_.begin(), wanted_.end()), wanted_.end());
  const auto later = std::partition(wanted_.begin(), wanted_.end(), [&](uint32_t word) { return take(word); });
  taken_.assign(wanted_.begin(), later);
  wanted_.erase(wanted_.begin(), later);
  if (taken_.empty()) return;
  // Room for all of it first: places in a pool that grows later would be the old ones.
  size_t tiles = size_t(tile_count_);
  changes_.clear();
  for (const uint32_t word : taken_) is_tile(word) ? ++tiles : brick_of_slice(missing_number(word));
  if (source_.field) {
    grow(page_pool_, size_t(page_count_), growth);
    for (Pool* pool : {&visibility_, &depth_, &certificate_}) grow(*pool, resident_.size(), growth);
  }
  grow(sums_, tiles, growth);
  if (source_.view.coverage.radiance) grow(radiance_, tiles, growth);
  for (const uint32_t word : taken_) is_tile(word) ? add_tile(missing_number(word), packet) : add_slice(word, packet);
  for (const Change& c : changes_) packet.add(c.pool->buffer.address() + c.index * k_word, &c.value, 1);
}

FieldView FieldMirror::view() const {
  FieldView v = source_.view;
  v.top = top_pool_.buffer.as<const int32_t>();
  v.pages = page_pool_.buffer.as<const int32_t>();
  v.visibility = visibility_.buffer.as<const uint8_t>();
  v.depth = depth_.buffer.as<const int32_t>();
  v.certificate = certificate_.buffer.as<const int32_t>();
  v.primitive = nullptr;
  v.coverage.tile_of = tile_table_.buffer.as<const int32_t>();
  v.coverage.sums = sums_.buffer.as<const int32_t>();
  v.coverage.radiance = radiance_.buffer.as<const float>();
  return v;
}

}  // namespace fieldtrace::gpu
