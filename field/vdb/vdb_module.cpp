// The functions of field/grid/vdb_grid.h by OpenVDB.
#include "field/grid/vdb_grid.h"

#include <openvdb/openvdb.h>

#include <type_traits>
#include <utility>

#include "field/vdb/vdb_archive.h"

namespace fieldtrace {

struct VdbGrid {
  openvdb::Int32Grid::Ptr grid;
};

namespace {

using Leaf = openvdb::Int32Tree::LeafNodeType;
static_assert(Leaf::DIM == k_vdb_leaf_side && sizeof(Leaf::NodeMaskType) == sizeof(VdbMask));
// The node above the leaves, whose tiles have the size of a leaf.
constexpr openvdb::Index k_tile_level = 1;

openvdb::Coord coord(const VoxelCoord& c) { return {c[0], c[1], c[2]}; }
VoxelCoord voxel(const openvdb::Coord& c) { return {c.x(), c.y(), c.z()}; }

VdbGridPtr wrap(openvdb::Int32Grid::Ptr grid) { return VdbGridPtr(new VdbGrid{std::move(grid)}); }

VdbGridPtr create(const char* name, int32_t background) {
  const auto grid = openvdb::Int32Grid::create(background);
  grid->setName(name);
  return wrap(grid);
}

void destroy(VdbGrid* grid) { delete grid; }

void add_tile(VdbGrid& grid, const VoxelCoord& origin, int32_t value) {
  grid.grid->tree().addTile(k_tile_level, coord(origin), value, /*active=*/true);
}

void add_leaf(VdbGrid& grid, const VoxelCoord& origin, const VdbLeaf& from) {
  Leaf* const leaf = grid.grid->tree().touchLeaf(coord(origin));
  for (int i = 0; i < k_vdb_leaf_voxels; ++i) {
    if (is_active(from.active, i)) leaf->setValueOn(openvdb::Index(i), from.values[size_t(i)]);
  }
}

// ---- files

VdbStoredGrid stored(const openvdb::Int32Grid::ConstPtr& grid) {
  VdbStoredGrid result;
  result.name = grid->getName();
  result.background = grid->background();
  std::vector<const Leaf*> leaves;
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
    VdbStoredLeaf stored = {voxel(leaf->origin()), int32_t(leaves.size()), {}};
    for (size_t i = 0; i < stored.active.size(); ++i) {
      stored.active[i] = leaf->valueMask().getWord<uint64_t>(openvdb::Index(i));
    }
    result.leaves.push_back(stored);
    leaves.push_back(&*leaf);
  }
  auto tile = grid->tree().cbeginValueOn();
  tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  for (; tile; ++tile) {
    openvdb::CoordBBox box;
    tile.getBoundingBox(box);
    result.tiles.push_back({voxel(box.min()), box.dim().x(), *tile});
  }
  sort_by_origin(result);
  result.unpack = [grid, held = std::move(leaves)](const VdbStoredLeaf& leaf, VdbValues& values) {
    const int32_t* const all = held[size_t(leaf.number)]->buffer().data();
    for (int i = 0; i < k_vdb_leaf_voxels; ++i)
      values[size_t(i)] = is_active(leaf.active, i) ? all[i] : grid->background();
    return true;
  };
  return result;
}

template <class T>
bool take(const openvdb::MetaMap& map, const std::string& key, VdbMetadata& to) {
  const auto entry = map.getMetadata<openvdb::TypedMetadata<T>>(key);
  if (!entry) return false;
  if constexpr (std::is_same_v<T, openvdb::Vec3s>) {
    const openvdb::Vec3s v = entry->value();
    to[key] = std::array<float, 3>{v[0], v[1], v[2]};
  } else {
    to[key] = entry->value();
  }
  return true;
}

void insert_all(openvdb::MetaMap& map, const VdbMetadata& metadata) {
  for (const auto& [key, held] : metadata) {
    std::visit(
        [&map, &key = key](const auto& value) {
          using T = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<T, std::array<float, 3>>) {
            map.insertMeta(key, openvdb::Vec3SMetadata({value[0], value[1], value[2]}));
          } else {
            map.insertMeta(key, openvdb::TypedMetadata<T>(value));
          }
        },
        held);
  }
}

VdbFile read(std::string bytes, int most_grids) {
  VdbContents contents = VdbArchive().read_bytes(std::move(bytes), most_grids);
  VdbFile file;
  const openvdb::MetaMap& map = contents.metadata;
  for (auto entry = map.beginMeta(); entry != map.endMeta(); ++entry) {
    const std::string& key = entry->first;
    // Of these types are all that VdbArchive accepts.
    take<int32_t>(map, key, file.metadata) || take<int64_t>(map, key, file.metadata) ||
        take<float>(map, key, file.metadata) || take<std::string>(map, key, file.metadata) ||
        take<openvdb::Vec3s>(map, key, file.metadata);
  }
  for (openvdb::GridBase::Ptr& grid : contents.grids) {
    file.grids.push_back(stored(openvdb::gridPtrCast<openvdb::Int32Grid>(std::exchange(grid, nullptr))));
  }
  return file;
}

void write(const std::string& path, std::span<const VdbGrid* const> grids, const VdbMetadata& metadata) {
  openvdb::MetaMap map;
  insert_all(map, metadata);
  openvdb::GridCPtrVec written;
  for (const VdbGrid* grid : grids) {
    if (grid->grid->empty()) continue;
    insert_all(*grid->grid, metadata);
    written.push_back(grid->grid);
  }
  VdbArchive archive;
  archive.setCompression(
      openvdb::io::COMPRESS_ACTIVE_MASK |
      (openvdb::io::Archive::hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC : openvdb::io::COMPRESS_ZIP));
  archive.write_file(path, written, map);
}

}  // namespace

extern "C" const VdbFunctions* fieldtrace_vdb() {
  static constexpr VdbFunctions functions = {
      .create = create, .destroy = destroy, .add_tile = add_tile, .add_leaf = add_leaf, .read = read, .write = write};
  openvdb::initialize();  // may be called again
  return &functions;
}

// The program calls it by this type.
static_assert(std::is_same_v<decltype(fieldtrace_vdb), VdbEntry>);

}  // namespace fieldtrace
