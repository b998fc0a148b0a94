#include "field/store/coverage.h"

#include <algorithm>

#include "core/platform/shared_value.h"

namespace fieldtrace {
namespace {

constexpr int k_side = scalar::k_tile_lines;
constexpr int32_t k_unknown = 0, k_empty = 1, k_claimed = -1;
// Sums are addressed by 31-bit word offsets.
constexpr uint64_t k_most_tiles = (uint64_t(1) << 31) / scalar::k_tile_words - 1;

int32_t thin_feature_ratio_of(std::span<const uint16_t> lines) {
  int thin = 0, edges = 0;
  const auto differs = [&](int i, int j) { return (lines[size_t(i)] != 0) != (lines[size_t(j)] != 0); };
  for (int y = 0; y < k_side; ++y) {
    for (int x = 0; x < k_side; ++x) {
      const int i = y * k_side + x;
      const bool left = x > 0 && differs(i, i - 1), right = x + 1 < k_side && differs(i, i + 1);
      const bool below = y > 0 && differs(i, i - k_side), above = y + 1 < k_side && differs(i, i + k_side);
      edges += left + below;
      thin += (left && right) || (below && above);
    }
  }
  return edges ? int32_t(scalar::k_thin_feature_steps * float(thin) / float(edges)) : 0;
}

int32_t line_word(uint16_t line) { return line == 0 ? 0 : 1 + (int32_t(line - 1) << scalar::k_count_bits); }

}  // namespace

int CoverageTiles::lines_for(int plane) { return std::min(2 * plane, 512); }

uint64_t CoverageTiles::table_bytes(int directions, int plane) {
  const uint64_t slots = slots_for(directions, plane);
  return slots * sizeof(int32_t) + parts_of(slots);
}

uint64_t CoverageTiles::pool_bytes(int directions, int plane, TilePayload payload) {
  const uint64_t tile = k_tile_bytes + (payload == TilePayload::radiance ? k_radiance_bytes : 0);
  return (k_fixed_tiles + pool_tiles(slots_for(directions, plane), payload)) * tile;
}

uint64_t CoverageTiles::slots_for(int directions, int plane) {
  const auto tiles = uint64_t(lines_for(plane) / k_side);
  return uint64_t(directions) * uint64_t(directions) * tiles * tiles;
}

uint64_t CoverageTiles::pool_tiles(uint64_t slots, TilePayload payload) {
  const uint64_t most = payload == TilePayload::radiance ? k_most_tiles / 3 : k_most_tiles;
  return std::min(slots, most - k_fixed_tiles);
}

CoverageTiles::CoverageTiles(int directions, int plane, FieldBudget* budget, TilePayload payload, double pool_share)
    : directions_(directions), lines_(lines_for(plane)), tiles_(lines_ / k_side), budget_(budget) {
  const uint64_t slots = slots_for(directions, plane);
  const bool has_radiance = payload == TilePayload::radiance;
  max_tiles_ = k_fixed_tiles + uint32_t(double(pool_tiles(slots, payload)) * pool_share);
  tile_of_ = VirtualBuffer<int32_t>(slots);
  sums_ = VirtualBuffer<int32_t>(size_t(max_tiles_) * scalar::k_tile_words);
  if (has_radiance) radiance_ = VirtualBuffer<float>(size_t(max_tiles_) * 3 * scalar::k_tile_words);
  touched_ = VirtualBuffer<uint8_t>(parts_of(slots));
}

CoverageView CoverageTiles::view() const {
  return {tiles_, 0.5f * float(lines_), tile_of_.data(), sums_.data(), radiance_.data()};
}

uint64_t CoverageTiles::bytes_when_full() const {
  const uint64_t tile = k_tile_bytes + (radiance_.data() ? k_radiance_bytes : 0);
  return uint64_t(slot_count()) * sizeof(int32_t) + uint64_t(max_tiles_) * tile;
}

CoverageTiles::Place CoverageTiles::place(uint32_t slot) const {
  const uint32_t per_plane = uint32_t(tiles_ * tiles_), tile = slot % per_plane;
  return {slot / per_plane, int(tile) % tiles_ * k_side, int(tile) / tiles_ * k_side};
}

bool CoverageTiles::charge(uint64_t bytes) {
  if (budget_ && !budget_->take(bytes)) {
    full_.store(true, std::memory_order_relaxed);
    return false;
  }
  committed_.fetch_add(bytes, std::memory_order_relaxed);
  return true;
}

// To be called before a slot is first written: charges its part of the table.
bool CoverageTiles::touch_part(uint32_t slot) {
  const auto part = shared(touched_[slot / k_part_slots]);
  if (part.load(std::memory_order_relaxed) != 0 || part.exchange(1, std::memory_order_relaxed) != 0) return true;
  return charge(uint64_t(std::min(k_part_slots, slot_count())) * sizeof(int32_t));
}

bool CoverageTiles::claim(uint32_t slot) {
  if (full() || !touch_part(slot)) return false;
  int32_t expected = k_unknown;
  return shared(tile_of_[slot]).compare_exchange_strong(expected, k_claimed, std::memory_order_acq_rel);
}

void CoverageTiles::give_back(uint32_t slot) { shared(tile_of_[slot]).store(k_unknown, std::memory_order_release); }

bool CoverageTiles::finished(uint32_t slot) const {
  return shared(tile_of_[slot]).load(std::memory_order_acquire) > k_unknown;
}

void CoverageTiles::store_radiance(int32_t tile, std::span<const Rgb> radiance) {
  float* sums = &radiance_[size_t(tile) * 3 * scalar::k_tile_words];
  DVec3 below[k_side] = {};
  for (int y = 0; y < k_side; ++y) {
    DVec3 row(0.0);
    float* corner = sums + 3 * ((y + 1) * scalar::k_tile_corners + 1);
    for (int x = 0; x < k_side; ++x) {
      row += DVec3(radiance[size_t(y * k_side + x)]);
      below[x] += row;
      for (int c = 0; c < 3; ++c) shared(corner[3 * x + c]).store(float(below[x][c]), std::memory_order_relaxed);
    }
  }
}

bool CoverageTiles::finish(uint32_t slot, std::span<const uint16_t> lines, std::span<const Rgb> radiance) {
  int32_t tile = k_empty;
  if (std::any_of(lines.begin(), lines.end(), [](uint16_t l) { return l != 0; })) {
    {
      const std::lock_guard lock(growth_);
      const bool is_last = tile_count_ >= max_tiles_;
      if (is_last && budget_) budget_->refuse_addresses();
      if (is_last || !charge(k_tile_bytes + (radiance.empty() ? 0 : k_radiance_bytes))) {
        full_.store(true, std::memory_order_relaxed);
        give_back(slot);
        return false;
      }
      tile = int32_t(tile_count_++);
    }
    int32_t* sums = &sums_[size_t(tile) * scalar::k_tile_words];
    int32_t below[k_side] = {};  // read back from new memory, they would fault twice a page
    for (int y = 0; y < k_side; ++y) {
      int32_t row = 0;
      int32_t* corner = sums + (y + 1) * scalar::k_tile_corners + 1;
      for (int x = 0; x < k_side; ++x) {
        row += line_word(lines[size_t(y * k_side + x)]);
        below[x] += row;
        shared(corner[x]).store(below[x], std::memory_order_relaxed);
      }
    }
    if (!radiance.empty()) store_radiance(tile, radiance);
    shared(sums[scalar::k_tile_thin_features]).store(thin_feature_ratio_of(lines), std::memory_order_relaxed);
    stored_.fetch_add(1, std::memory_order_relaxed);
  }
  baked_.fetch_add(1, std::memory_order_relaxed);
  shared(tile_of_[slot]).store(tile, std::memory_order_release);
  return true;
}

std::vector<uint32_t> CoverageTiles::baked() const {
  std::vector<uint32_t> slots;
  slots.reserve(tiles_baked());
  for (uint32_t begin = 0; begin < slot_count(); begin += k_part_slots) {
    if (shared(touched_[begin / k_part_slots]).load(std::memory_order_relaxed) == 0) continue;
    const uint32_t end = std::min(begin + k_part_slots, slot_count());
    for (uint32_t s = begin; s < end; ++s) {
      if (finished(s)) slots.push_back(s);
    }
  }
  return slots;
}

void CoverageTiles::read(uint32_t slot, std::span<uint16_t> lines) const {
  const int32_t* sums = &sums_[size_t(shared(tile_of_[slot]).load(std::memory_order_acquire)) * scalar::k_tile_words];
  for (int y = 0; y < k_side; ++y) {
    for (int x = 0; x < k_side; ++x) {
      const int32_t* c = sums + y * scalar::k_tile_corners + x;
      const int32_t word = (c[scalar::k_tile_corners + 1] - c[scalar::k_tile_corners]) - (c[1] - c[0]);
      lines[size_t(y * k_side + x)] = word == 0 ? uint16_t(0) : uint16_t((word >> scalar::k_count_bits) + 1);
    }
  }
}

}  // namespace fieldtrace
