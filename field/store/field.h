// One object's displacement field: a two-level table over a pool of bricks that grows on demand.
//
// Memory layout: field/store/layout.hd.h. Every layer is a VirtualBuffer indexed by brick * 512 + cell, so that a layer
// that a scene does not need costs no memory. Page 0 and brick 0 stay zero. Thread-safety: view() may be read while
// other threads bake: a reader sees a cell either as unknown or complete, since cells are written as whole words,
// certificates last. claim, finish and give_back coordinate bakers.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "core/math/math.h"
#include "core/platform/address_space.h"
#include "core/platform/virtual_buffer.h"
#include "field/store/coverage.h"
#include "field/store/layout.hd.h"
#include "field/store/view.h"

namespace fieldtrace {

// The layers of cells, each baked on demand. `primitive` is read where a plane fit answers a nearest query.
enum class FieldLayer { visibility, depth, primitive };
inline constexpr int k_field_layers = 3;

// A set of slices of a brick: bit 16 * layer + direction in the brick.
using SliceMask = uint64_t;
constexpr SliceMask slices_of_layer(SliceMask mask, FieldLayer layer) { return mask >> (16 * int(layer)) & 0xffffu; }

inline constexpr int k_max_lines = 32;

struct FieldParameters {
  int directions = 64;  // D: cells along each side of the direction map; 32, 64, 128 or 256
  int plane = 128;      // N: cells along each side of the plane; 64, 128, 256 or 512
  int lines = 16;       // K: lines traced to certify a cell; 4 ... k_max_lines
};

// Whether a Field can have these parameters.
bool valid_parameters(const FieldParameters& parameters);

// The ball that a field is defined over: encloses `bounds` with room for rounding, so that the object lies strictly
// inside.
Sphere field_ball(const Bounds3& bounds);

// World -> unit space of a ball in object space, 3 x 4, column-major; composed in double.
void write_unit_transform(const Affine& to_object, const Sphere& ball, float out[12]);

// A slice's place in the chart, and its cells in the pool.
struct SliceAddress {
  int u = 0, v = 0;    // direction cell
  int a0 = 0, b0 = 0;  // first plane cell; the slice spans 4 x 8
};

// A brick in use: its place in the chart, its number in the pool, and which of its slices are finished.
struct BrickPlace {
  uint32_t direction_brick = 0, plane_brick = 0;
  uint32_t brick = 0;
  SliceMask finished = 0;
};

class Field {
 public:
  // `budget`, if not null, is charged for what is baked, and must outlive the field. `address_space`: bytes that the
  // field may reserve; where they do not suffice the pool is smaller, and may fill up before the budget does. Throws
  // Error if the system refuses even the tables; UsageError for parameters outside the lists above.
  Field(const Sphere& ball, const FieldParameters& parameters, FieldBudget* budget = nullptr,
        uint64_t address_space = k_no_address_limit);
  ~Field();
  Field(const Field&) = delete;
  Field& operator=(const Field&) = delete;

  const FieldParameters& parameters() const { return parameters_; }
  const Sphere& ball() const { return ball_; }
  const FieldBudget* budget() const { return budget_; }
  FieldView view() const;
  CoverageTiles& coverage() { return coverage_; }
  const CoverageTiles& coverage() const { return coverage_; }

  uint32_t slice_count() const;  // in the whole chart
  SliceAddress slice_address(uint32_t slice) const;

  // Reserves a slice of a layer for the caller to bake; returns the pool index of its first cell. Empty: another thread
  // has it, it is baked, or the pool is full.
  std::optional<uint32_t> claim(FieldLayer layer, uint32_t slice);
  // Publishes a claimed slice after its 32 cells are written.
  void finish(FieldLayer layer, uint32_t slice);
  // Undoes the claim of a slice that could not be baked: another thread may then claim it.
  void give_back(FieldLayer layer, uint32_t slice);
  // Whether the slice can be read. Never becomes true if the pool is full.
  bool finished(FieldLayer layer, uint32_t slice) const;
  bool pool_full() const { return pool_full_.load(std::memory_order_relaxed); }

  // Cell storage for the baker that claimed it; relaxed atomic stores.
  void store_visibility(uint32_t cell, uint8_t code);
  void store_plane_fit(uint32_t cell, uint32_t depth_word, uint32_t certificate);
  void store_primitive(uint32_t cell, uint32_t primitive);  // k_none: none

  // Cells of the visibility and depth layers.
  uint64_t cells_baked() const { return cells_baked_.load(std::memory_order_relaxed); }
  uint64_t primitives_baked() const { return primitives_baked_.load(std::memory_order_relaxed); }  // cells with one
  uint64_t cells_full() const { return uint64_t(slice_count()) * scalar::k_slice_cells; }
  // Memory in use: tables, the layers of bricks in which anything was claimed, and coverage tiles.
  uint64_t bytes() const { return committed_.load(std::memory_order_relaxed) + coverage_.bytes(); }
  // Upper bound on bytes() with these parameters.
  static uint64_t most_bytes(const FieldParameters& parameters);
  // Address space of a whole pool with its tables; of the tables alone, the least a field needs.
  static uint64_t reserved_bytes(const FieldParameters& parameters);
  static uint64_t table_bytes(const FieldParameters& parameters);
  // Bytes of one brick's cells of a layer.
  static uint64_t brick_bytes(FieldLayer layer);

  // For files: the pool index of a brick by its place; 0 if it does not exist.
  uint32_t brick_at(uint32_t direction_brick, uint32_t plane_brick) const;
  // Creates the brick if need be; 0 if the pool is full.
  uint32_t brick_for(uint32_t direction_brick, uint32_t plane_brick);
  // The bricks with at least one finished slice, by direction brick and then plane brick.
  std::vector<BrickPlace> bricks() const;
  SliceMask finished_mask(uint32_t brick) const;

 private:
  uint32_t brick_of_slice(uint32_t slice) const;
  bool charge(uint64_t bytes);

  Sphere ball_;
  FieldParameters parameters_;
  FieldBudget* budget_ = nullptr;
  uint32_t max_bricks_ = 0;
  VirtualBuffer<int32_t> top_, pages_;
  VirtualBuffer<uint8_t> visibility_;
  VirtualBuffer<int32_t> depth_, certificate_, primitive_;
  VirtualBuffer<SliceMask> claimed_, finished_;  // per brick
  std::mutex growth_;
  std::atomic<uint32_t> brick_count_ = 1, page_count_ = 1;
  std::atomic<uint64_t> cells_baked_ = 0, primitives_baked_ = 0, committed_ = 0;
  std::atomic<bool> pool_full_ = false;
  CoverageTiles coverage_;
};

}  // namespace fieldtrace
