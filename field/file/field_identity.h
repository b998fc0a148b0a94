// What identifies a field, or direction maps: the geometry by content, the chart and its parameters. Names cache files.
//
// A brick's content depends on nothing else, so two fields of one identity agree wherever both are baked.
// Thread-safety: values and pure functions.
#pragma once

#include <cstdint>
#include <string>

#include "core/scene/scene.h"
#include "field/file/hash.h"
#include "field/store/field.h"

namespace fieldtrace {

// Part of every identity: raised whenever the bytes of a baked cell, or the file that holds them, change their meaning.
inline constexpr int k_field_format_version = 10;

inline constexpr const char* k_chart_orthographic = "orthographic";
inline constexpr const char* k_chart_thesis = "thesis";
inline constexpr const char* k_chart_maps = "maps";  // direction maps: D directions, T texels as the plane

struct FieldIdentity {
  Hash128 geometry;              // of the geometry that lines are traced against
  uint32_t primitive_count = 0;  // triangles; 1 for an analytic shape
  std::string chart = k_chart_orthographic;
  FieldParameters parameters;
  int format_version = k_field_format_version;

  bool operator==(const FieldIdentity&) const;
  Hash128 hash() const;           // of all of the above
  std::string file_name() const;  // hash().hex() + ".vdb": the name in a cache
};

// Hash of a shape's geometry in object space. Meshes and rectangles: the positions in their order, and the triangles
// (shading normals, texture coordinates and the name do not matter to a field); analytic shapes: the kind.
Hash128 geometry_hash(const Shape& shape);

FieldIdentity field_identity(const Shape& shape, const FieldParameters& parameters);

}  // namespace fieldtrace
