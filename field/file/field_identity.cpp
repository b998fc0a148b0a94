#include "field/file/field_identity.h"

#include <tuple>

namespace fieldtrace {
namespace {

const char* kind_name(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::mesh:
    case ShapeKind::rectangle:
      return "triangles";
    case ShapeKind::sphere:
      return "sphere";
    case ShapeKind::disk:
      return "disk";
    case ShapeKind::cylinder:
      return "cylinder";
  }
  return "";
}

void add_text(Hasher& hasher, const std::string& text) {
  hasher.add_value(uint64_t(text.size()));
  hasher.add(text.data(), text.size());
}

auto tied(const FieldIdentity& i) {
  return std::tuple(i.geometry.high, i.geometry.low, i.primitive_count, i.chart, i.parameters.directions,
                    i.parameters.plane, i.parameters.lines, i.format_version);
}

}  // namespace

bool FieldIdentity::operator==(const FieldIdentity& other) const { return tied(*this) == tied(other); }

Hash128 FieldIdentity::hash() const {
  Hasher hasher;
  hasher.add_value(geometry.high);
  hasher.add_value(geometry.low);
  hasher.add_value(primitive_count);
  add_text(hasher, chart);
  for (const int value : {parameters.directions, parameters.plane, parameters.lines, format_version}) {
    hasher.add_value(int32_t(value));
  }
  return hasher.result();
}

std::string FieldIdentity::file_name() const { return hash().hex() + ".vdb"; }

Hash128 geometry_hash(const Shape& shape) {
  Hasher hasher;
  add_text(hasher, kind_name(shape.kind));
  if (is_meshed(shape.kind)) {
    const TriangleMesh& mesh = shape.mesh;
    static_assert(sizeof(Vec3) == 12 && sizeof(UVec3) == 12, "hashed as packed arrays");
    hasher.add_value(uint64_t(mesh.positions.size()));
    hasher.add(mesh.positions.data(), mesh.positions.size() * sizeof(Vec3));
    hasher.add_value(uint64_t(mesh.triangles.size()));
    hasher.add(mesh.triangles.data(), mesh.triangles.size() * sizeof(UVec3));
  }
  return hasher.result();
}

FieldIdentity field_identity(const Shape& shape, const FieldParameters& parameters) {
  FieldIdentity identity;
  identity.geometry = geometry_hash(shape);
  identity.primitive_count = is_meshed(shape.kind) ? uint32_t(shape.mesh.triangles.size()) : 1;
  identity.parameters = parameters;
  return identity;
}

}  // namespace fieldtrace
