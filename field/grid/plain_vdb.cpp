#include "field/grid/plain_vdb.h"

#include <blosc.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>

namespace fieldtrace {
namespace {

constexpr int64_t k_magic = 0x56444220;
constexpr uint32_t k_file_version = 224;
constexpr size_t k_uuid_bytes = 36;
constexpr uint32_t k_active_mask_and_blosc = 2 | 4;
constexpr std::string_view k_grid_type = "Tree_int32_5_4_3", k_transform = "UniformScaleMap";
constexpr size_t k_transform_bytes = 5 * 3 * sizeof(double);
constexpr int8_t k_inactive_are_background = 0;
// Sides of the nodes above the leaves, in children.
constexpr int k_lower_log2 = 4, k_upper_log2 = 5;
// And of the highest in voxels.
constexpr int k_upper_side = k_vdb_leaf_side << (k_lower_log2 + k_upper_log2);

// Thrown where a file is not as expected; never leaves this file.
struct Unusual {};

void require(bool expected) {
  if (!expected) throw Unusual{};
}

class Bytes {
 public:
  explicit Bytes(std::string_view all) : all_(all) {}

  std::string_view take(size_t count) {
    require(count <= all_.size() - at_);
    at_ += count;
    return all_.substr(at_ - count, count);
  }
  template <class T>
  T get() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view text() { return take(get<uint32_t>()); }
  VoxelCoord coord() {
    VoxelCoord c;
    for (int32_t& axis : c) axis = get<int32_t>();
    return c;
  }

 private:
  std::string_view all_;
  size_t at_ = 0;
};

// ---- values

// Reads `count` values, those of active voxels, packed as the file holds them.
std::string_view take_values(Bytes& in, size_t count) {
  require(in.get<int8_t>() == k_inactive_are_background);
  const auto bytes = in.get<int64_t>();
  require(bytes > 0);  // else they are not packed, as where Blosc fails
  const std::string_view packed = in.take(size_t(bytes));
  size_t unpacked = 0;
  require(blosc_cbuffer_validate(packed.data(), packed.size(), &unpacked) == 0 && unpacked == count * sizeof(int32_t));
  return packed;
}

bool unpack_values(std::string_view packed, std::span<int32_t> values) {
  if (values.empty()) return true;
  return blosc_decompress_ctx(packed.data(), values.data(), values.size_bytes(), /*numinternalthreads=*/1) ==
         int(values.size_bytes());
}

template <size_t Words>
using Mask = std::array<uint64_t, Words>;

template <size_t Words>
size_t count_of(const Mask<Words>& mask) {
  size_t count = 0;
  for (const uint64_t word : mask) count += size_t(std::popcount(word));
  return count;
}

// Calls visit(i) for each bit, ascending.
template <size_t Words, class Visit>
void visit_bits(const Mask<Words>& mask, const Visit& visit) {
  for (size_t w = 0; w < Words; ++w) {
    for (uint64_t left = mask[w]; left != 0; left &= left - 1) visit(64 * w + size_t(std::countr_zero(left)));
  }
}

bool unpack_leaf(std::string_view packed, const VdbMask& active, int32_t background, VdbValues& values) {
  const size_t count = count_of(active);
  VdbValues held;
  if (!unpack_values(packed, std::span(held).first(count))) return false;
  if (count == held.size()) {
    values = held;
    return true;
  }
  values.fill(background);
  const int32_t* next = held.data();
  visit_bits(active, [&](size_t voxel) { values[voxel] = *next++; });
  return true;
}

// ---- trees

VoxelCoord child_origin(const VoxelCoord& origin, size_t child, int log2, int side) {
  const size_t along = (size_t(1) << log2) - 1;
  return {origin[0] + int32_t(child >> (2 * log2)) * side, origin[1] + int32_t(child >> log2 & along) * side,
          origin[2] + int32_t(child & along) * side};
}

// The first pass: tiles, and the leaves' masks, without their values.
class Topology {
 public:
  Topology(Bytes& in, VdbStoredGrid& grid) : in_(in), grid_(grid) {}

  void read() {
    require(in_.get<int32_t>() == 1);  // buffers of a leaf
    grid_.background = in_.get<int32_t>();
    require(in_.get<uint32_t>() == 0);  // tiles of 4096^3 voxels
    VoxelCoord before = {-1, 0, 0};
    for (auto left = in_.get<uint32_t>(); left > 0; --left) {
      const VoxelCoord origin = in_.coord();
      require(before < origin);  // so no part of the grid is there twice
      // As the coordinates of field files do, they begin at 0, and so never overflow.
      for (const int32_t axis : origin) require(axis >= 0 && axis < 1 << 30 && axis % k_upper_side == 0);
      inner<k_upper_log2>(origin);
      before = origin;
    }
  }

 private:
  template <int Log2>
  void inner(const VoxelCoord& origin) {
    constexpr size_t children = size_t(1) << (3 * Log2);
    constexpr int side = Log2 == k_upper_log2 ? k_vdb_leaf_side << k_lower_log2 : k_vdb_leaf_side;
    using InnerMask = Mask<children / 64>;
    const auto child = in_.get<InnerMask>(), active = in_.get<InnerMask>();
    for (size_t w = 0; w < child.size(); ++w) require((child[w] & active[w]) == 0);
    std::vector<int32_t> values(count_of(active));
    require(unpack_values(take_values(in_, values.size()), values));
    const int32_t* next = values.data();
    visit_bits(active, [&](size_t i) { grid_.tiles.push_back({child_origin(origin, i, Log2, side), side, *next++}); });
    visit_bits(child, [&](size_t i) {
      const VoxelCoord at = child_origin(origin, i, Log2, side);
      if constexpr (Log2 == k_upper_log2) {
        inner<k_lower_log2>(at);
      } else {
        grid_.leaves.push_back({at, int32_t(grid_.leaves.size()), in_.get<VdbMask>()});
      }
    });
  }

  Bytes& in_;
  VdbStoredGrid& grid_;
};

VdbStoredGrid read_tree(Bytes& in, const std::shared_ptr<const std::string>& file) {
  VdbStoredGrid grid;
  Topology(in, grid).read();
  // The second pass: each leaf's mask again, and its values.
  std::vector<std::string_view> packed;
  for (const VdbStoredLeaf& leaf : grid.leaves) {
    require(in.get<VdbMask>() == leaf.active);
    packed.push_back(take_values(in, count_of(leaf.active)));
  }
  sort_by_origin(grid);
  grid.unpack = [file, held = std::move(packed), background = grid.background](const VdbStoredLeaf& leaf,
                                                                               VdbValues& values) {
    return unpack_leaf(held[size_t(leaf.number)], leaf.active, background, values);
  };
  return grid;
}

// ---- files

void skip_metadata(Bytes& in) {
  for (auto left = in.get<uint32_t>(); left > 0; --left) {
    for (int i = 0; i < 3; ++i) in.text();  // name, type, value
  }
}

VdbMetadata read_metadata(Bytes& in) {
  VdbMetadata metadata;
  for (auto left = in.get<uint32_t>(); left > 0; --left) {
    const std::string name(in.text());
    const std::string_view type = in.text(), bytes = in.text();
    const auto take = [&](auto value) {
      require(bytes.size() == sizeof value);
      std::memcpy(&value, bytes.data(), sizeof value);
      metadata[name] = value;
    };
    if (type == "string")
      metadata[name] = std::string(bytes);
    else if (type == "int32")
      take(int32_t());
    else if (type == "int64")
      take(int64_t());
    else if (type == "float")
      take(float());
    else if (type == "vec3s")
      take(std::array<float, 3>());
    else
      require(false);
  }
  return metadata;
}

VdbStoredGrid read_grid(Bytes& in, const std::shared_ptr<const std::string>& file) {
  const std::string_view name = in.text();
  require(std::all_of(name.begin(), name.end(), [](char c) { return c >= ' '; }));  // OpenVDB marks names held twice
  require(in.text() == k_grid_type && in.text().empty());                           // and names grids that share trees
  in.take(3 * sizeof(int64_t));                                                     // where in the file it lies
  require(in.get<uint32_t>() == k_active_mask_and_blosc);
  skip_metadata(in);
  require(in.text() == k_transform);
  in.take(k_transform_bytes);
  VdbStoredGrid grid = read_tree(in, file);
  grid.name = name;
  return grid;
}

}  // namespace

std::optional<VdbFile> read_plain_vdb(const std::shared_ptr<const std::string>& bytes, int most_grids) {
  static_assert(std::endian::native == std::endian::little);
  Bytes in(*bytes);
  try {
    require(in.get<int64_t>() == k_magic && in.get<uint32_t>() == k_file_version);
    in.take(2 * sizeof(uint32_t));  // version of the library
    require(in.get<char>() == 1);   // offsets of grids
    in.take(k_uuid_bytes);
    VdbFile file = {read_metadata(in), {}};
    const auto grids = in.get<int32_t>();
    require(grids >= 0 && grids <= most_grids);
    for (int32_t i = 0; i < grids; ++i) file.grids.push_back(read_grid(in, bytes));
    return file;
  } catch (const Unusual&) {
    return std::nullopt;
  }
}

}  // namespace fieldtrace
