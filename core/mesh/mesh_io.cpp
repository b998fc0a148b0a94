#include "core/mesh/mesh_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>

#include "core/io/atomic_file.h"
#include "core/io/file_ending.h"
#include "core/io/input_file.h"
#include "core/math/finite.h"
#include "core/mesh/mesh_parts.h"
#include "core/mesh/mesh_readers.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

struct CloseFile {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

struct Bytes {
  std::unique_ptr<char[]> data;
  size_t size = 0;
  std::string_view view() const { return {data.get(), size}; }
};

Bytes read_file(const std::string& path) {
  const SourceLocation where{path};
  std::error_code ec;
  if (!fs::exists(path, ec)) throw Error(where, "no such mesh file, check the path");
  if (is_folder(path)) throw Error(where, "is a folder, name a .obj or .ply file in it");
  const uint64_t size = require_regular_file(path);
  File file(std::fopen(path.c_str(), "rb"));
  if (!file) throw Error(where, std::string("cannot be read: ") + std::strerror(errno));
  Bytes bytes{std::make_unique_for_overwrite<char[]>(size), size_t(size)};
  if (std::fread(bytes.data.get(), 1, bytes.size, file.get()) != bytes.size) {
    throw Error(where, "cannot be read to its end, check the disk");
  }
  return bytes;
}

MeshFormat format_by_ending(const std::string& path) {
  const std::string ending = file_ending(path);
  if (ending == ".obj") return MeshFormat::obj;
  if (ending == ".ply") return MeshFormat::ply;
  throw Error({path}, "unknown kind of mesh file, convert it to .obj or .ply");
}

const char* plural(uint64_t n) { return n == 1 ? "" : "s"; }

void check_arrays(const TriangleMesh& mesh, const SourceLocation& where) {
  const size_t n = mesh.positions.size();
  if (!mesh.normals.empty() && mesh.normals.size() != n) {
    throw Error(where, fmt::format("{} normals for {} vertices, give one for each or none", mesh.normals.size(), n));
  }
  if (!mesh.texcoords.empty() && mesh.texcoords.size() != n) {
    throw Error(where, fmt::format("{} texture coordinates for {} vertices, give one for each or none",
                                   mesh.texcoords.size(), n));
  }
  if (mesh.triangles.empty()) throw Error(where, "has no triangles, nothing to render");
  for (size_t i = 0; i < n; ++i) {
    if (!is_finite(mesh.positions[i])) throw Error(where, fmt::format("vertex {} is not finite, mend the mesh", i));
  }
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const UVec3& t = mesh.triangles[i];
    const uint32_t largest = std::max({t.x, t.y, t.z});
    if (largest >= n) {
      throw Error(where, fmt::format("triangle {} refers to vertex {}, but there are only {}", i, largest, n));
    }
  }
}

void drop_degenerate(TriangleMesh& mesh, const SourceLocation& where, const WarningSink& warning) {
  const size_t before = mesh.triangles.size();
  // Differences and products of floats are (nearly) exact in double, so comparing with 0 needs no epsilon at any scale.
  std::erase_if(mesh.triangles, [&](const UVec3& t) {
    const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    return glm::cross(b - a, c - a) == DVec3(0.0);
  });
  if (mesh.triangles.empty()) throw Error(where, "every triangle has zero area, mend the mesh");
  if (const size_t n = before - mesh.triangles.size()) {
    warn(warning, where, fmt::format("{} triangle{} of zero area dropped", n, plural(n)));
  }
}

void mend_normals(TriangleMesh& mesh, const SourceLocation& where, const WarningSink& warning) {
  std::vector<uint32_t> bad;
  for (size_t i = 0; i < mesh.normals.size(); ++i) {
    const DVec3 n(mesh.normals[i]);  // in double: the length of any finite float vector is finite
    const double length = glm::length(n);
    if (length > 0.0 && std::isfinite(length)) {
      mesh.normals[i] = Vec3(n / length);
    } else {
      bad.push_back(uint32_t(i));
    }
  }
  if (bad.empty()) return;
  const std::vector<Vec3> computed = vertex_normals(mesh);
  for (const uint32_t i : bad) mesh.normals[i] = computed[i];
  warn(warning, where, fmt::format("{} normal{} zero or not finite, computed anew", bad.size(), plural(bad.size())));
}

void mend_texcoords(TriangleMesh& mesh, const SourceLocation& where, const WarningSink& warning) {
  size_t bad = 0;
  for (Vec2& t : mesh.texcoords) {
    if (std::isfinite(t.x) && std::isfinite(t.y)) continue;
    t = Vec2(0.0f);
    ++bad;
  }
  if (bad) warn(warning, where, fmt::format("{} texture coordinate{} not finite, set to 0", bad, plural(bad)));
}

}  // namespace

std::string mesh_readers::quote(std::string_view text) {
  constexpr size_t k_longest = 40;
  std::string s = "\"";
  for (const char c : text.substr(0, k_longest)) s += c >= ' ' && c <= '~' ? c : '?';
  return s + (text.size() > k_longest ? "...\"" : "\"");
}

void validate_mesh(TriangleMesh& mesh, const std::string& name, const WarningSink& warning) {
  const SourceLocation where{name};
  check_arrays(mesh, where);
  drop_degenerate(mesh, where, warning);
  drop_unused_vertices(mesh);
  mend_normals(mesh, where, warning);
  mend_texcoords(mesh, where, warning);
}

TriangleMesh load_mesh(const std::string& path, const MeshLoadOptions& options, const WarningSink& warning) {
  const SourceLocation where{path};
  const bool obj = (options.format ? *options.format : format_by_ending(path)) == MeshFormat::obj;
  mesh_readers::RawMesh raw;
  {
    const Bytes bytes = read_file(path);
    raw = obj ? mesh_readers::read_obj(path, bytes.view()) : mesh_readers::read_ply(path, bytes.view(), warning);
  }
  TriangleMesh mesh = std::move(raw.mesh);
  if (raw.uncut_polygons) {
    warn(warning, where,
         fmt::format("{} polygon{} cross themselves or have too many corners, and are cut as if convex",
                     raw.uncut_polygons, plural(raw.uncut_polygons)));
  }
  if (raw.short_polygons) {
    warn(warning, where,
         fmt::format("{} polygon{} of fewer than three corners dropped", raw.short_polygons,
                     plural(raw.short_polygons)));
  }
  if (options.face_normals) mesh.normals.clear();
  validate_mesh(mesh, path, warning);

  if (options.compute_normals && !options.face_normals && mesh.normals.empty()) compute_vertex_normals(mesh);
  if (options.flip_tex_coords.value_or(obj)) {
    for (Vec2& t : mesh.texcoords) t.y = 1.0f - t.y;
  }
  return mesh;
}

// ---------------------------------------------------------------- PLY out

namespace {

// Buffers output in large pieces.
class Writer {
 public:
  explicit Writer(CheckedFile& file) : file_(file) { buffer_.reserve(k_piece + k_slack); }
  void bytes(const void* data, size_t size) {
    buffer_.append(static_cast<const char*>(data), size);
    flush(k_piece);
  }
  template <class... Args>
  void print(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(buffer_), format, std::forward<Args>(args)...);
    flush(k_piece);
  }
  void finish() { flush(0); }

 private:
  static constexpr size_t k_piece = size_t(1) << 20, k_slack = 4096;
  void flush(size_t above) {
    if (buffer_.size() <= above) return;
    file_.write_at(file_.end(), buffer_.data(), buffer_.size());
    buffer_.clear();
  }
  CheckedFile& file_;
  std::string buffer_;
};

// Little endian on any machine, as binary PLY declares its byte order.
void put_word(char*& at, uint32_t word) {
  for (int b = 0; b < 4; ++b) *at++ = char(word >> (8 * b) & 0xffu);
}
void put_float(char*& at, float value) {
  uint32_t word;
  std::memcpy(&word, &value, sizeof word);
  put_word(at, word);
}

void write_body(Writer& out, const TriangleMesh& mesh) {
  const bool normals = !mesh.normals.empty(), texcoords = !mesh.texcoords.empty();
  out.print("ply\nformat binary_little_endian 1.0\n");
  out.print("element vertex {}\nproperty float x\nproperty float y\nproperty float z\n", mesh.positions.size());
  if (normals) out.print("property float nx\nproperty float ny\nproperty float nz\n");
  if (texcoords) out.print("property float s\nproperty float t\n");
  out.print("element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.triangles.size());
  char record[8 * sizeof(float)];
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    char* at = record;
    for (int c = 0; c < 3; ++c) put_float(at, mesh.positions[i][c]);
    for (int c = 0; normals && c < 3; ++c) put_float(at, mesh.normals[i][c]);
    for (int c = 0; texcoords && c < 2; ++c) put_float(at, mesh.texcoords[i][c]);
    out.bytes(record, size_t(at - record));
  }
  for (const UVec3& t : mesh.triangles) {
    char* at = record;
    *at++ = 3;
    for (int c = 0; c < 3; ++c) put_word(at, t[c]);
    out.bytes(record, size_t(at - record));
  }
}

}  // namespace

void save_ply(const std::string& path, const TriangleMesh& mesh) {
  AtomicFile file(path);
  CheckedFile checked(file.temporary_path());
  Writer out(checked);
  write_body(out, mesh);
  out.finish();
  checked.close();
  if (checked.failed()) throw Error({path}, "cannot be written: " + checked.reason());
  file.commit();
}

}  // namespace fieldtrace
