#include "field/store/field.h"

#include <algorithm>
#include <bit>

#include "core/platform/shared_value.h"
#include "core/scene/scene.h"

namespace fieldtrace {
namespace {

// Cells are addressed by 31-bit offsets into the pool.
constexpr uint32_t k_max_pool_bricks = (1u << 31) / scalar::k_brick_cells - 1;

SliceMask slice_bit(FieldLayer layer, uint32_t direction_in_brick) {
  return SliceMask(1) << (direction_in_brick + 16 * uint32_t(layer));
}

template <class T>
T load_shared(const T& value) {
  return shared(value).load(std::memory_order_acquire);
}

bool power_between(int value, int low, int high) {
  return value >= low && value <= high && std::has_single_bit(unsigned(value));
}

// Why a Field cannot have these parameters; null if it can.
const char* fault_of(const FieldParameters& p) {
  if (!power_between(p.directions, 32, 256)) return "directions must be a power of two from 32 to 256";
  if (!power_between(p.plane, 64, 512)) return "plane must be a power of two from 64 to 512";
  return p.lines < 4 || p.lines > k_max_lines ? "lines per cell must lie in 4 ... 32" : nullptr;
}

const FieldParameters& checked(const FieldParameters& p) {
  if (const char* fault = fault_of(p)) throw UsageError(fault);
  return p;
}

uint64_t direction_bricks_of(const FieldParameters& p) {
  return uint64_t(p.directions / 4) * uint64_t(p.directions / 4);
}
uint64_t plane_bricks_of(const FieldParameters& p) { return uint64_t(p.plane / 4) * uint64_t(p.plane / 8); }

// Bricks of a whole pool, brick 0 included.
uint64_t pool_bricks(const FieldParameters& p) {
  return std::min<uint64_t>(direction_bricks_of(p) * plane_bricks_of(p) + 1, k_max_pool_bricks);
}

uint64_t bytes_of_all_layers() {  // of one brick
  uint64_t bytes = 0;
  for (int layer = 0; layer < k_field_layers; ++layer) bytes += Field::brick_bytes(FieldLayer(layer));
  return bytes;
}

// The part of a whole pool, 0 to 1, that fits into an address space of that size beside the tables.
double pool_share(const FieldParameters& p, uint64_t address_space) {
  const uint64_t whole = Field::reserved_bytes(p), tables = Field::table_bytes(p);
  if (address_space >= whole) return 1.0;
  return address_space > tables ? double(address_space - tables) / double(whole - tables) : 0.0;
}

}  // namespace

bool valid_parameters(const FieldParameters& p) { return !fault_of(p); }

Sphere field_ball(const Bounds3& bounds) {
  Sphere ball;
  ball.centre = bounds.centre();
  // Room for rounding of the centre, the diagonal and the transform into unit space, all relative to the largest
  // coordinate; and a minimum for an object that is a point.
  const float largest = glm::length(glm::max(glm::abs(bounds.lower), glm::abs(bounds.upper)));
  ball.radius = 0.5f * glm::length(bounds.diagonal()) * (1.0f + gamma_bound(16)) + gamma_bound(8) * largest;
  ball.radius = std::max(ball.radius, std::numeric_limits<float>::min());
  return ball;
}

void write_unit_transform(const Affine& to_object, const Sphere& ball, float out[12]) {
  const double inverse_radius = 1.0 / double(ball.radius);
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      const double shift = column == 3 ? double(ball.centre[row]) : 0.0;
      out[column * 3 + row] = float((double(to_object[column][row]) - shift) * inverse_radius);
    }
  }
}

Field::Field(const Sphere& ball, const FieldParameters& parameters, FieldBudget* budget, uint64_t address_space)
    : ball_(ball),
      parameters_(checked(parameters)),
      budget_(budget),
      coverage_(parameters.directions, parameters.plane, budget, TilePayload::none,
                pool_share(parameters, address_space)) {
  const size_t direction_bricks = direction_bricks_of(parameters);
  max_bricks_ = uint32_t(double(pool_bricks(parameters) - 1) * pool_share(parameters, address_space)) + 1;
  const size_t cells = size_t(max_bricks_) * scalar::k_brick_cells;
  top_ = VirtualBuffer<int32_t>(direction_bricks);
  pages_ = VirtualBuffer<int32_t>((direction_bricks + 1) * plane_bricks_of(parameters));
  visibility_ = VirtualBuffer<uint8_t>(cells + 4);  // look-ups read whole words
  depth_ = VirtualBuffer<int32_t>(cells);
  certificate_ = VirtualBuffer<int32_t>(cells);
  primitive_ = VirtualBuffer<int32_t>(cells);
  claimed_ = VirtualBuffer<SliceMask>(max_bricks_);
  finished_ = VirtualBuffer<SliceMask>(max_bricks_);
  charge(direction_bricks * sizeof(int32_t));
}

Field::~Field() {
  if (budget_) budget_->give_back(bytes());
}

uint64_t Field::brick_bytes(FieldLayer layer) {
  constexpr uint64_t k_cell_bytes[k_field_layers] = {1, 2 * sizeof(int32_t), sizeof(int32_t)};
  return uint64_t(scalar::k_brick_cells) * k_cell_bytes[int(layer)];
}

uint64_t Field::most_bytes(const FieldParameters& p) {
  const uint64_t direction_bricks = direction_bricks_of(p);
  const uint64_t bricks = direction_bricks * plane_bricks_of(p);
  const uint64_t tiles = CoverageTiles::slots_for(p.directions, p.plane);
  return sizeof(int32_t) * (direction_bricks + bricks + tiles) + bricks * bytes_of_all_layers() +
         tiles * CoverageTiles::k_tile_bytes;
}

uint64_t Field::table_bytes(const FieldParameters& p) {
  const uint64_t direction_bricks = direction_bricks_of(p);
  return sizeof(int32_t) * (direction_bricks + (direction_bricks + 1) * plane_bricks_of(p)) +
         CoverageTiles::table_bytes(p.directions, p.plane);
}

uint64_t Field::reserved_bytes(const FieldParameters& p) {
  const uint64_t brick = 2 * sizeof(SliceMask) + bytes_of_all_layers();
  return table_bytes(p) + pool_bricks(p) * brick + CoverageTiles::pool_bytes(p.directions, p.plane);
}

bool Field::charge(uint64_t bytes) {
  if (budget_ && !budget_->take(bytes)) {
    pool_full_.store(true, std::memory_order_relaxed);
    return false;
  }
  committed_.fetch_add(bytes, std::memory_order_relaxed);
  return true;
}

FieldView Field::view() const {
  FieldView v;
  v.directions = make_axis(parameters_.directions);
  v.plane = make_axis(parameters_.plane);
  v.direction_bricks = parameters_.directions / 4;
  v.plane_bricks_b = parameters_.plane / 8;
  v.plane_bricks = (parameters_.plane / 4) * (parameters_.plane / 8);
  v.top = top_.data();
  v.pages = pages_.data();
  v.visibility = visibility_.data();
  v.depth = depth_.data();
  v.certificate = certificate_.data();
  v.primitive = primitive_.data();
  v.coverage = coverage_.view();
  return v;
}

uint32_t Field::slice_count() const {
  const FieldView v = view();
  return uint32_t(parameters_.directions) * uint32_t(parameters_.directions) * uint32_t(v.plane_bricks);
}

SliceAddress Field::slice_address(uint32_t slice) const {
  const FieldView v = view();
  const int plane_brick = int(slice % uint32_t(v.plane_bricks));
  const int direction = int(slice / uint32_t(v.plane_bricks));
  const int direction_brick = direction >> 4, in_brick = direction & 15;
  SliceAddress at;
  at.u = (direction_brick / v.direction_bricks) * 4 + (in_brick >> 2);
  at.v = (direction_brick % v.direction_bricks) * 4 + (in_brick & 3);
  at.a0 = (plane_brick / v.plane_bricks_b) * 4;
  at.b0 = (plane_brick % v.plane_bricks_b) * 8;
  return at;
}

uint32_t Field::brick_at(uint32_t direction_brick, uint32_t plane_brick) const {
  const int32_t page = load_shared(top_[direction_brick]);
  return uint32_t(load_shared(pages_[size_t(page) * view().plane_bricks + plane_brick]));
}

std::vector<BrickPlace> Field::bricks() const {
  std::vector<BrickPlace> places;
  const FieldView v = view();
  for (int d = 0; d < v.direction_bricks * v.direction_bricks; ++d) {
    const int32_t page = load_shared(top_[d]);
    if (page == 0) continue;
    for (int p = 0; p < v.plane_bricks; ++p) {
      const uint32_t brick = uint32_t(load_shared(pages_[size_t(page) * v.plane_bricks + p]));
      if (brick == 0) continue;
      if (const SliceMask mask = finished_mask(brick)) places.push_back({uint32_t(d), uint32_t(p), brick, mask});
    }
  }
  return places;
}

uint32_t Field::brick_of_slice(uint32_t slice) const {
  const uint32_t plane_bricks = uint32_t(view().plane_bricks);
  return brick_at(slice / plane_bricks / 16, slice % plane_bricks);
}

uint32_t Field::brick_for(uint32_t direction_brick, uint32_t plane_brick) {
  if (const uint32_t brick = brick_at(direction_brick, plane_brick)) return brick;
  const std::lock_guard lock(growth_);
  if (const uint32_t brick = brick_at(direction_brick, plane_brick)) return brick;
  const uint32_t brick = brick_count_.load(std::memory_order_relaxed);
  if (brick >= max_bricks_) {
    pool_full_.store(true, std::memory_order_relaxed);
    if (budget_) budget_->refuse_addresses();
    return 0;
  }
  int32_t page = load_shared(top_[direction_brick]);
  if (page == 0) {
    if (!charge(uint64_t(view().plane_bricks) * sizeof(int32_t))) return 0;
    page = int32_t(page_count_.fetch_add(1, std::memory_order_relaxed));
    shared(top_[direction_brick]).store(page, std::memory_order_release);
  }
  brick_count_.store(brick + 1, std::memory_order_relaxed);
  shared(pages_[size_t(page) * view().plane_bricks + plane_brick]).store(int32_t(brick), std::memory_order_release);
  return brick;
}

std::optional<uint32_t> Field::claim(FieldLayer layer, uint32_t slice) {
  const uint32_t plane_bricks = uint32_t(view().plane_bricks);
  const uint32_t direction = slice / plane_bricks;
  const uint32_t brick = brick_for(direction / 16, slice % plane_bricks);
  if (brick == 0) return std::nullopt;
  const SliceMask bit = slice_bit(layer, direction % 16);
  const SliceMask before = shared(claimed_[brick]).fetch_or(bit, std::memory_order_acq_rel);
  if (before & bit) return std::nullopt;
  const bool is_first = slices_of_layer(before, layer) == 0;  // in the brick
  if (is_first && !charge(brick_bytes(layer))) {
    give_back(layer, slice);
    return std::nullopt;
  }
  return brick * uint32_t(scalar::k_brick_cells) + (direction % 16) * uint32_t(scalar::k_slice_cells);
}

void Field::finish(FieldLayer layer, uint32_t slice) {
  const uint32_t direction = slice / uint32_t(view().plane_bricks);
  const SliceMask bit = slice_bit(layer, direction % 16);
  shared(finished_[brick_of_slice(slice)]).fetch_or(bit, std::memory_order_release);
  (layer == FieldLayer::primitive ? primitives_baked_ : cells_baked_) += scalar::k_slice_cells;
}

void Field::give_back(FieldLayer layer, uint32_t slice) {
  const uint32_t direction = slice / uint32_t(view().plane_bricks);
  shared(claimed_[brick_of_slice(slice)]).fetch_and(~slice_bit(layer, direction % 16), std::memory_order_acq_rel);
}

bool Field::finished(FieldLayer layer, uint32_t slice) const {
  const uint32_t direction = slice / uint32_t(view().plane_bricks);
  const uint32_t brick = brick_of_slice(slice);
  return brick != 0 && (load_shared(finished_[brick]) & slice_bit(layer, direction % 16)) != 0;
}

void Field::store_visibility(uint32_t cell, uint8_t code) {
  shared(visibility_[cell]).store(code, std::memory_order_relaxed);
}

void Field::store_plane_fit(uint32_t cell, uint32_t depth_word, uint32_t certificate) {
  shared(depth_[cell]).store(int32_t(depth_word), std::memory_order_relaxed);
  shared(certificate_[cell]).store(int32_t(certificate), std::memory_order_release);
}

void Field::store_primitive(uint32_t cell, uint32_t primitive) {
  const int32_t word = primitive == k_none ? scalar::k_no_primitive : int32_t(primitive) + scalar::k_first_primitive;
  shared(primitive_[cell]).store(word, std::memory_order_relaxed);
}

SliceMask Field::finished_mask(uint32_t brick) const { return load_shared(finished_[brick]); }

}  // namespace fieldtrace
