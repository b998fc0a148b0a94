#include "field/file/field_info.h"

#include <algorithm>
#include <bit>

#include "field/bake/bake_full.h"
#include "field/store/risk_classes.h"

namespace fieldtrace {
namespace {

void count_cell(LayerInfo& info, bool hit, int risk, int max_class) {
  ++info.cells_baked;
  if (risk > max_class) {
    ++info.undecided;
  } else {
    ++(hit ? info.blocked : info.clear);
  }
}

void add(LayerInfo& sum, const LayerInfo& part) {
  sum.cells_baked += part.cells_baked;
  sum.clear += part.clear;
  sum.blocked += part.blocked;
  sum.undecided += part.undecided;
  sum.one_sided += part.one_sided;
}

void add(CoverageInfo& sum, const CoverageInfo& part) {
  sum.tiles_baked += part.tiles_baked;
  sum.tiles_empty += part.tiles_empty;
  sum.lines_baked += part.lines_baked;
  sum.lines_hit += part.lines_hit;
}

}  // namespace

LayerInfo layer_info(const Field& field, FieldLayer layer, float tolerance) {
  LayerInfo info;
  info.cells_reachable = reachable_cells(field.parameters(), layer);
  const int max_class = max_class_at(tolerance);
  const FieldView view = field.view();
  for (const BrickPlace& place : field.bricks()) {
    for (size_t i = 0; i < size_t(scalar::k_brick_cells); ++i) {
      const size_t slice = i / scalar::k_slice_cells, cell = size_t(place.brick) * scalar::k_brick_cells + i;
      if ((slices_of_layer(place.finished, layer) >> slice & 1) == 0) continue;
      if (layer == FieldLayer::visibility) {
        const int bits = view.visibility[cell] - 1;
        count_cell(info, (bits & 1) != 0, bits >> 1, max_class);
      } else {
        const int32_t word = view.certificate[cell];
        const int kind = word & 3, risk = word >> 2 & 63;
        count_cell(info, kind != scalar::k_kind_miss, risk, max_class);
        info.one_sided += kind == scalar::k_kind_one_sided && risk <= max_class;
      }
    }
  }
  return info;
}

uint64_t primitives_baked(const Field& field) {
  uint64_t slices = 0;
  for (const BrickPlace& place : field.bricks()) {
    slices += uint64_t(std::popcount(slices_of_layer(place.finished, FieldLayer::primitive)));
  }
  return slices * scalar::k_slice_cells;
}

CoverageInfo coverage_info(const CoverageTiles& tiles) {
  CoverageInfo info;
  info.lines_across = tiles.lines();
  info.tiles_baked = tiles.tiles_baked();
  info.tiles_full = tiles.slot_count();
  info.tiles_empty = tiles.tiles_baked() - tiles.tiles_stored();
  info.lines_baked = tiles.lines_baked();
  TileLines lines(CoverageTiles::k_lines_per_tile);
  for (const uint32_t slot : tiles.baked()) {
    tiles.read(slot, lines);
    info.lines_hit += lines.size() - size_t(std::count(lines.begin(), lines.end(), uint16_t(0)));
  }
  return info;
}

FieldFileInfo field_info(const std::string& path, float tolerance) {
  const FieldFile file(path);
  FieldFileInfo info;
  info.header = file.header();
  info.bytes_disk = file.bytes();
  const Field none(info.header.ball, info.header.identity.parameters, nullptr, /*address_space=*/0);  // tables alone
  info.bytes_memory = none.bytes();
  info.cells_full = none.cells_full();
  info.visibility = layer_info(none, FieldLayer::visibility, tolerance);
  info.depth = layer_info(none, FieldLayer::depth, tolerance);
  info.coverage = coverage_info(none.coverage());
  file.visit_pieces([&](const Field& piece) {
    if (piece.pool_full() || piece.coverage().full()) {
      throw Error({path}, "takes more address space than may be reserved; raise the limit (ulimit -v)");
    }
    info.bytes_memory += piece.bytes() - none.bytes();
    info.bricks += piece.bricks().size();
    add(info.visibility, layer_info(piece, FieldLayer::visibility, tolerance));
    add(info.depth, layer_info(piece, FieldLayer::depth, tolerance));
    add(info.coverage, coverage_info(piece.coverage()));
    info.primitives_baked += primitives_baked(piece);
  });
  const uint64_t cells[k_field_layers] = {info.visibility.cells_baked, info.depth.cells_baked, info.primitives_baked};
  for (int layer = 0; layer < k_field_layers; ++layer) {
    info.bytes_cells += cells[layer] * (Field::brick_bytes(FieldLayer(layer)) / scalar::k_brick_cells);
  }
  info.bytes_coverage = (info.coverage.tiles_baked - info.coverage.tiles_empty) * CoverageTiles::k_tile_bytes;
  return info;
}

}  // namespace fieldtrace
