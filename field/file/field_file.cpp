#include "field/file/field_file.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <optional>
#include <tuple>

#include "core/platform/address_space.h"
#include "core/platform/parallel.h"
#include "field/file/coverage_grid.h"
#include "field/file/field_grids.h"
#include "field/file/field_vdb.h"
#include "field/store/risk_classes.h"

namespace fieldtrace {
namespace {

using GridArray = std::array<std::optional<VdbStoredGrid>, k_grid_count>;

constexpr FieldLayer k_layer_of_grid[k_grid_count] = {FieldLayer::visibility, FieldLayer::depth, FieldLayer::depth,
                                                      FieldLayer::primitive};

// ---- cells

bool valid_visibility(int32_t code) {
  // 1 + verdict + 2 * class.
  return code >= 1 && code <= 1 + 1 + 2 * k_worst_class;
}

bool valid_certificate(int32_t word) {
  const int kind = word & 3, risk = word >> 2 & 63;
  return kind >= scalar::k_kind_miss && kind <= scalar::k_kind_one_sided && risk <= k_worst_class && word >> 16 == 0;
}

bool valid_cell(GridLayer layer, int32_t value, uint32_t primitive_count) {
  switch (layer) {
    case k_grid_visibility:
      return valid_visibility(value);
    case k_grid_certificate:
      return valid_certificate(value);
    case k_grid_primitive:
      return uint32_t(value) < primitive_count || uint32_t(value) == k_none;
    default:
      return true;  // every code of depth and normal is valid
  }
}

// A brick with all its layers, as the grids hold it.
struct BrickData {
  std::array<BrickCells, k_grid_count> cells;
  SliceMask finished = 0;
};

int32_t primitive_in_file(int32_t word) { return word - scalar::k_first_primitive; }

// Adds the slices of `source` that `brick` lacks.
void add_slices(const FieldView& source, const BrickPlace& place, BrickData& brick) {
  const SliceMask wanted = place.finished & ~brick.finished;
  const size_t first = size_t(place.brick) * scalar::k_brick_cells;
  for (size_t i = 0; i < size_t(scalar::k_brick_cells); ++i) {
    const size_t slice = i / scalar::k_slice_cells;
    const auto is_wanted = [&](FieldLayer layer) { return (slices_of_layer(wanted, layer) >> slice & 1) != 0; };
    if (is_wanted(FieldLayer::visibility)) brick.cells[k_grid_visibility][i] = source.visibility[first + i];
    if (is_wanted(FieldLayer::depth)) {
      brick.cells[k_grid_depth][i] = source.depth[first + i];
      brick.cells[k_grid_certificate][i] = source.certificate[first + i];
    }
    if (is_wanted(FieldLayer::primitive)) {
      brick.cells[k_grid_primitive][i] = primitive_in_file(source.primitive[first + i]);
    }
  }
  brick.finished |= place.finished;
}

std::vector<VdbGridPtr> make_grids(std::span<const Field* const> fields, const FieldIdentity& identity) {
  std::vector<VdbGridPtr> grids;
  for (const char* name : k_grid_names) grids.push_back(vdb().create(name, /*background=*/0));
  struct Source {
    BrickPlace place;
    size_t field;
  };
  std::vector<Source> sources;
  for (size_t f = 0; f < fields.size(); ++f) {
    for (const BrickPlace& place : fields[f]->bricks()) sources.push_back({place, f});
  }
  const auto where = [](const Source& s) { return std::tuple(s.place.direction_brick, s.place.plane_brick); };
  std::sort(sources.begin(), sources.end(), [&](const Source& a, const Source& b) {
    return std::tuple_cat(where(a), std::tuple(a.field)) < std::tuple_cat(where(b), std::tuple(b.field));
  });
  for (size_t i = 0; i < sources.size();) {
    BrickData brick{};
    const BrickPlace& place = sources[i].place;
    const auto at = where(sources[i]);
    for (; i < sources.size() && where(sources[i]) == at; ++i) {
      add_slices(fields[sources[i].field]->view(), sources[i].place, brick);
    }
    const VoxelCoord origin = brick_origin(identity.parameters, place.direction_brick, place.plane_brick);
    for (int g = 0; g < k_grid_count; ++g) {
      add_brick(*grids[g], origin, brick.cells[g], uint32_t(slices_of_layer(brick.finished, k_layer_of_grid[g])));
    }
  }
  return grids;
}

VdbGridPtr make_coverage_grid(std::span<const Field* const> fields) {
  VdbGridPtr grid = vdb().create(k_coverage_grid_name, /*background=*/0);
  std::vector<const CoverageTiles*> sources;
  for (const Field* field : fields) sources.push_back(&field->coverage());
  write_coverage(sources, *grid);
  return grid;
}

void add_slices_to(Hasher& hasher, uint32_t direction_brick, uint32_t plane_brick, SliceMask finished) {
  for (const uint32_t value : {direction_brick, plane_brick}) hasher.add_value(value);
  hasher.add_value(finished);
}

void add_tiles_to(Hasher& hasher, std::span<const uint32_t> slots) {
  hasher.add_value(uint32_t(slots.size()));
  for (const uint32_t slot : slots) hasher.add_value(slot);
}

bool same_ball(const Sphere& a, const Sphere& b) { return a.centre == b.centre && a.radius == b.radius; }

bool same_parameters(const FieldParameters& a, const FieldParameters& b) {
  return a.directions == b.directions && a.plane == b.plane && a.lines == b.lines;
}

}  // namespace

// ---- reading

struct FieldFile::Grids {
  GridArray grids;  // nothing: the file has nothing of that layer
  // Of the bricks that have any layer, ascending.
  std::vector<VoxelCoord> origins;
  CoverageGrid coverage;

  bool read(const VoxelCoord& origin, BrickData& brick) const;
  // Finds the origins and checks every brick; returns the slices' hash.
  Hash128 validate(const FieldFileHeader& header, const std::string& path);
};

// False if a slice of the brick is incomplete, or in only one of the two depth grids.
bool FieldFile::Grids::read(const VoxelCoord& origin, BrickData& brick) const {
  uint32_t slices[k_grid_count] = {};
  for (int g = 0; g < k_grid_count; ++g) {
    if (grids[g] && !read_brick(*grids[g], origin, brick.cells[g], slices[g])) return false;
  }
  brick.finished = 0;
  for (int g = 0; g < k_grid_count; ++g) brick.finished |= SliceMask(slices[g]) << (16 * int(k_layer_of_grid[g]));
  return slices[k_grid_depth] == slices[k_grid_certificate];
}

Hash128 FieldFile::Grids::validate(const FieldFileHeader& header, const std::string& path) {
  for (const std::optional<VdbStoredGrid>& grid : grids) {
    if (!grid) continue;
    std::vector<VoxelCoord> some;
    if (!brick_origins(*grid, some)) throw FieldFileError(path, "has tiles that are not bricks");
    origins.insert(origins.end(), some.begin(), some.end());
  }
  std::sort(origins.begin(), origins.end());
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
  std::vector<SliceMask> finished(origins.size());
  std::atomic<bool> is_sound = true;
  parallel_for_parts(origins.size(), [&](size_t first, size_t end) {
    BrickData brick{};
    for (size_t b = first; b < end && is_sound; ++b) {
      uint32_t direction_brick = 0, plane_brick = 0;
      bool sound = place_of_origin(header.identity.parameters, origins[b], direction_brick, plane_brick);
      sound = sound && read(origins[b], brick);
      for (int g = 0; sound && g < k_grid_count; ++g) {
        const SliceMask slices = slices_of_layer(brick.finished, k_layer_of_grid[g]);
        for (size_t i = 0; i < brick.cells[g].size(); ++i) {
          if ((slices >> (i / scalar::k_slice_cells) & 1) == 0) continue;
          sound = sound && valid_cell(GridLayer(g), brick.cells[g][i], header.identity.primitive_count);
        }
      }
      finished[b] = brick.finished;
      if (!sound) is_sound = false;
    }
  });
  if (!is_sound) throw FieldFileError(path, "has cells that no bake writes");
  Hasher hasher;
  for (size_t b = 0; b < origins.size(); ++b) {
    uint32_t direction_brick = 0, plane_brick = 0;
    place_of_origin(header.identity.parameters, origins[b], direction_brick, plane_brick);
    add_slices_to(hasher, direction_brick, plane_brick, finished[b]);
  }
  add_tiles_to(hasher, coverage.slots());
  return hasher.result();
}

FieldFile::FieldFile(const std::string& path) : grids_(std::make_unique<Grids>()) {
  FieldVdb file = read_field_vdb(path);
  std::error_code failed;
  bytes_ = std::filesystem::file_size(path, failed);
  header_ = file.header;
  require_chart(header_, k_chart_orthographic, path);
  for (int g = 0; g < k_grid_count; ++g) grids_->grids[g] = take_grid(file, k_grid_names[g], path);
  const std::optional<VdbStoredGrid> coverage = take_grid(file, k_coverage_grid_name, path);
  const FieldParameters& p = header_.identity.parameters;
  if (coverage && !grids_->coverage.open(*coverage, p.directions, p.plane)) {
    throw FieldFileError(path, "has coverage tiles that no bake writes");
  }
  slices_ = grids_->validate(header_, path);
}

FieldFile::~FieldFile() = default;

FieldFile::Copied FieldFile::copy_to(Field& field) const {
  if (!same_ball(field.ball(), header_.ball)) return Copied::nothing;
  if (!same_parameters(field.parameters(), header_.identity.parameters)) return Copied::nothing;
  std::atomic<bool> all = true;
  parallel_for_parts(grids_->origins.size(), [&](size_t first, size_t end) {
    if (all && !copy_bricks(field, first, end)) all = false;
  });
  parallel_for_parts(grids_->coverage.slots().size(), [&](size_t first, size_t end) {
    if (all && !copy_tiles(field, first, end)) all = false;
  });
  return all ? Copied::all : Copied::part;
}

void FieldFile::visit_pieces(const std::function<void(const Field&)>& visit) const {
  const std::vector<VoxelCoord>& origins = grids_->origins;
  for (size_t first = 0, end = 0; first < origins.size(); first = end) {
    while (end < origins.size() && origins[end][0] == origins[first][0]) ++end;
    Field piece(header_.ball, header_.identity.parameters, nullptr, reservable_bytes());
    copy_bricks(piece, first, end);
    visit(piece);
  }
  const std::vector<uint32_t>& slots = grids_->coverage.slots();
  const auto part = [&](size_t i) { return slots[i] / CoverageTiles::k_part_slots; };
  for (size_t first = 0, end = 0; first < slots.size(); first = end) {
    while (end < slots.size() && part(end) == part(first)) ++end;
    Field piece(header_.ball, header_.identity.parameters, nullptr, reservable_bytes());
    copy_tiles(piece, first, end);
    visit(piece);
  }
}

bool FieldFile::copy_bricks(Field& field, size_t first_brick, size_t end_brick) const {
  const uint32_t plane_bricks = uint32_t(field.view().plane_bricks);
  BrickData brick{};
  for (size_t b = first_brick; b < end_brick; ++b) {
    const VoxelCoord& origin = grids_->origins[b];
    uint32_t direction_brick, plane_brick;
    place_of_origin(field.parameters(), origin, direction_brick, plane_brick);
    grids_->read(origin, brick);
    for (uint32_t bit = 0; bit < 16 * k_field_layers; ++bit) {
      if ((brick.finished >> bit & 1) == 0) continue;
      const auto layer = FieldLayer(bit / 16);
      const uint32_t slice = (direction_brick * 16 + bit % 16) * plane_bricks + plane_brick;
      const std::optional<uint32_t> first = field.claim(layer, slice);
      if (!first) {
        if (field.pool_full() && !field.finished(layer, slice)) return false;
        continue;  // baked, or claimed by another thread
      }
      const size_t in_brick = size_t(bit % 16) * scalar::k_slice_cells;
      for (size_t i = 0; i < size_t(scalar::k_slice_cells); ++i) {
        const auto value = [&](GridLayer g) { return uint32_t(brick.cells[g][in_brick + i]); };
        const uint32_t cell = *first + uint32_t(i);
        switch (layer) {
          case FieldLayer::visibility:
            field.store_visibility(cell, uint8_t(value(k_grid_visibility)));
            break;
          case FieldLayer::depth:
            field.store_plane_fit(cell, value(k_grid_depth), value(k_grid_certificate));
            break;
          case FieldLayer::primitive:
            field.store_primitive(cell, value(k_grid_primitive));
            break;
        }
      }
      field.finish(layer, slice);
    }
  }
  return true;
}

bool FieldFile::copy_tiles(Field& field, size_t first, size_t end) const {
  CoverageTiles& tiles = field.coverage();
  for (size_t i = first; i < end; ++i) {
    const uint32_t slot = grids_->coverage.slots()[i];
    if (!tiles.claim(slot)) {
      if (tiles.full() && !tiles.finished(slot)) return false;
      continue;  // baked, or claimed by another thread
    }
    if (!tiles.finish(slot, grids_->coverage.lines(slot))) return false;
  }
  return true;
}

Hash128 slices_hash(const Field& field) {
  Hasher hasher;
  for (const BrickPlace& p : field.bricks()) add_slices_to(hasher, p.direction_brick, p.plane_brick, p.finished);
  add_tiles_to(hasher, field.coverage().baked());
  return hasher.result();
}

LoadedField load_field(Field& field, const FieldIdentity& identity, const std::string& path) {
  // A thread that waits for parts of its file begins nothing else: no other file, which would lie in memory as well.
  return tbb::this_task_arena::isolate([&]() -> LoadedField {
    const FieldFile file(path);
    const FieldIdentity& held = file.header().identity;
    if (held.geometry != identity.geometry || held.primitive_count != identity.primitive_count) {
      throw FieldFileError(path, "belongs to another mesh");
    }
    if (!(held == identity)) throw FieldFileError(path, "has another chart or other parameters");
    const FieldFile::Copied copied = file.copy_to(field);
    if (copied == FieldFile::Copied::nothing) throw FieldFileError(path, "has another bounding sphere");
    return {file.slices(), copied == FieldFile::Copied::all};
  });
}

// ---- writing

void save_fields(std::span<const Field* const> fields, const FieldIdentity& identity, const std::string& path) {
  std::vector<VdbGridPtr> grids = make_grids(fields, identity);
  grids.push_back(make_coverage_grid(fields));
  write_field_vdb(grids, identity, fields.front()->ball(), path);
}

void save_field(const Field& field, const FieldIdentity& identity, const std::string& path) {
  const Field* const one[] = {&field};
  save_fields(one, identity, path);
}

}  // namespace fieldtrace
