// The coverage tiles of one field (field/store/coverage.hd.h): a table over a pool that grows on demand.
//
// Thread-safety: view() may be read while other threads bake: a tile's number enters the table after its sums. claim,
// finish and give_back coordinate bakers.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/platform/virtual_buffer.h"
#include "field/store/coverage.hd.h"
#include "field/store/field_budget.h"
#include "field/store/view.h"

namespace fieldtrace {

// What a line of a tile meets: its depth code + 1, or 0 for nothing.
using TileLines = std::vector<uint16_t>;  // 32 x 32, row by row

// What tiles hold in addition to hits and depths.
enum class TilePayload { none, radiance };

class CoverageTiles {
 public:
  CoverageTiles() = default;
  // For D x D directions and planes of N x N cells. `budget`, if not null, is charged for what is baked, and must
  // outlive the tiles. `pool_share`: the part of a whole pool's address space to reserve, 0 to 1. Throws Error if the
  // system refuses it.
  CoverageTiles(int directions, int plane, FieldBudget* budget = nullptr, TilePayload payload = TilePayload::none,
                double pool_share = 1.0);

  // L for planes of N x N cells: two lines for each cell along each side, within limits.
  static int lines_for(int plane);
  // Tiles of all directions.
  static uint64_t slots_for(int directions, int plane);
  // Address space of the tables; of a whole pool.
  static uint64_t table_bytes(int directions, int plane);
  static uint64_t pool_bytes(int directions, int plane, TilePayload payload = TilePayload::none);

  CoverageView view() const;
  int lines() const { return lines_; }  // L
  // A tile's direction cell (u * D + v) and first texel.
  struct Place {
    uint32_t direction = 0;
    int x = 0, y = 0;
  };
  Place place(uint32_t slot) const;
  uint32_t slot_count() const { return uint32_t(directions_) * uint32_t(directions_) * uint32_t(tiles_ * tiles_); }

  // Reserves a tile for the caller to bake. False: another thread has it, it is baked, or the pool is full.
  bool claim(uint32_t slot);
  // Publishes a claimed tile of 32 x 32 lines. False, with the tile given back, if the pool is full. `radiance`, with
  // that payload: of each line that hits, 0 for the others.
  bool finish(uint32_t slot, std::span<const uint16_t> lines, std::span<const Rgb> radiance = {});
  void give_back(uint32_t slot);
  bool finished(uint32_t slot) const;
  bool full() const { return full_.load(std::memory_order_relaxed); }
  // How many more non-empty tiles the pool has room for.
  uint64_t room() const { return max_tiles_ - k_fixed_tiles - tiles_stored(); }

  // The baked slots, ascending; and their lines as passed to finish(). Reads only the parts of the table in which
  // anything was claimed.
  std::vector<uint32_t> baked() const;
  void read(uint32_t slot, std::span<uint16_t> lines) const;
  uint64_t tiles_baked() const { return baked_.load(std::memory_order_relaxed); }
  uint64_t tiles_stored() const { return stored_.load(std::memory_order_relaxed); }  // those that are not empty
  uint64_t lines_baked() const { return tiles_baked() * k_lines_per_tile; }
  uint64_t bytes_when_full() const;  // with every slot baked and the pool full
  // Memory in use: sums, and the parts of the table that were written.
  uint64_t bytes() const { return committed_.load(std::memory_order_relaxed); }

  static constexpr uint64_t k_lines_per_tile = uint64_t(scalar::k_tile_lines) * scalar::k_tile_lines;
  static constexpr uint64_t k_tile_bytes = uint64_t(scalar::k_tile_words) * sizeof(int32_t);
  static constexpr uint64_t k_radiance_bytes = 3 * uint64_t(scalar::k_tile_words) * sizeof(float);
  // Slots in a part of the table: what one page of memory holds.
  static constexpr uint32_t k_part_slots = 1024;
  static constexpr uint32_t k_fixed_tiles = 2;  // 0: not baked, 1: empty; both all zero

 private:
  static uint64_t pool_tiles(uint64_t slots, TilePayload payload);  // in a whole pool
  static uint64_t parts_of(uint64_t slots) { return (slots + k_part_slots - 1) / k_part_slots; }
  bool charge(uint64_t bytes);
  void store_radiance(int32_t tile, std::span<const Rgb> radiance);
  bool touch_part(uint32_t slot);

  int directions_ = 0, lines_ = 0, tiles_ = 0;
  uint32_t max_tiles_ = 0;
  FieldBudget* budget_ = nullptr;
  VirtualBuffer<int32_t> tile_of_, sums_;
  VirtualBuffer<float> radiance_;
  VirtualBuffer<uint8_t> touched_;  // per part of the table: not 0 once one of its slots was claimed
  std::mutex growth_;
  uint32_t tile_count_ = k_fixed_tiles;
  std::atomic<uint64_t> baked_ = 0, stored_ = 0, committed_ = 0;
  std::atomic<bool> full_ = false;
};

}  // namespace fieldtrace
