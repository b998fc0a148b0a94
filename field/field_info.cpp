#include "field/field_info.h"

#include "field/bake_full.h"
#include "field/risk.h"

namespace fieldtrace {
namespace {

void count_cell(LayerInfo& info, bool hit, int risk, int max_class) {
  ++info.cells_baked;
  if (risk > max_class) {
    ++info.ask;
  } else {
    ++(hit ? info.blocked : info.clear);
  }
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
      if (layer == FieldLayer::visibility && (place.finished >> slice & 1) != 0) {
        const int bits = view.visibility[cell] - 1;
        count_cell(info, (bits & 1) != 0, bits >> 1, max_class);
      }
      if (layer == FieldLayer::depth && (place.finished >> (slice + 16) & 1) != 0) {
        const int32_t word = view.certificate[cell];
        count_cell(info, (word & 3) != scalar::k_kind_miss, word >> 2 & 63, max_class);
      }
    }
  }
  return info;
}

FieldFileInfo field_info(const std::string& path, float tolerance) {
  const FieldFile file(path);
  FieldFileInfo info;
  info.header = file.header();
  info.bytes_disk = file.bytes();
  Field field(info.header.ball, info.header.identity.parameters);
  file.copy_to(field);
  info.bytes_memory = field.bytes();
  info.bricks = field.bricks().size();
  info.cells_full = field.cells_full();
  info.visibility = layer_info(field, FieldLayer::visibility, tolerance);
  info.depth = layer_info(field, FieldLayer::depth, tolerance);
  return info;
}

}  // namespace fieldtrace
