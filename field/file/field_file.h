// Fields in files: standard OpenVDB files (Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", ACM TOG
// 32(3), 2013) that vdb_print and any other OpenVDB program read, with a checksum behind them.
//
// Layout. One Int32Grid a layer, background 0, left out where nothing of the layer is baked:
//   visibility    the byte of a visibility cell
//   depth_normal  depth, bits 0-15, and octahedral normal, 16-31
//   certificate   kind, risk class, error bound
//   primitive     triangle that the line through the cell's centre meets, -1 for none; only where hits needed it
//   coverage      lines of coverage tiles (field/file/coverage_grid.h)
// the first four with the bits of field/store/layout.hd.h. Of these, one leaf of 8^3 voxels is one brick. The brick of
// direction brick (U, V), U and V in [0, D/4), and plane brick (A, B), A in [0, N/4), B in [0, N/8), is the leaf of
// index (U D/4 + V, A, B): its voxels begin at eight times that. The voxel at offset i of the leaf, i = 64 x + 8 y + z,
// is cell i of the brick, so that with (u, v, a, b) the cell's address in the field:
//   x = 8 (U D/4 + V) + 2 (u mod 4) + (v mod 4) div 2,   y = 8 A + 4 (v mod 2) + a mod 4,   z = b.
// A voxel is active if its slice is baked; depth_normal and certificate have the same active voxels. A brick all
// of whose 512 cells are baked and equal (all misses of class 0, mostly) is an active tile of 8^3 instead of a leaf.
// Compression: Blosc where OpenVDB has it, else zip; only active voxels are stored.
// Metadata of the file and of each grid: fieldtrace_format, chart, directions, plane, lines, centre, radius,
// mesh_hash, primitive_count.
// The OpenVDB file is followed by 32 bytes that OpenVDB does not look at: "FTFIELD", a byte of the format version, the
// size of what comes before, and its 128-bit hash. Nothing is decoded before these fit: OpenVDB trusts the sizes that
// it reads, and crashes on many a damaged file. So damage of any kind is an error. A file forged together with its
// checksum takes no more memory than its size is worth (field/vdb/vdb_archive.h), and cells that no bake writes are
// refused; more is not defended against. Other programs' copies of the grids lack the 32 bytes and are refused. Fields
// of the thesis' chart and direction maps have the same frame around other grids: thesis_file.h, maps_file.h.
//
// Thread-safety: distinct objects are independent. A field may be baked while it is saved or loaded into.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "core/platform/error.h"
#include "field/file/field_identity.h"

namespace fieldtrace {

// A field file that cannot be used. what() also says to bake it again; reason() does not.
class FieldFileError : public Error {
 public:
  FieldFileError(const std::string& path, const std::string& reason)
      : Error({path}, reason + "; bake it again"), reason_(reason) {}
  const std::string& reason() const { return reason_; }

 private:
  std::string reason_;
};

class MissingFieldFile : public FieldFileError {
 public:
  explicit MissingFieldFile(const std::string& path) : FieldFileError(path, "there is no such file") {}
};

struct FieldFileHeader {
  FieldIdentity identity;
  Sphere ball;  // object space
};

// A field file of the orthographic chart in memory, completely checked: the constructor throws FieldFileError for a
// file that is missing, damaged, truncated, not a field, of another chart or format version, or that holds values that
// no bake writes.
class FieldFile {
 public:
  explicit FieldFile(const std::string& path);
  ~FieldFile();
  FieldFile(const FieldFile&) = delete;
  FieldFile& operator=(const FieldFile&) = delete;

  const FieldFileHeader& header() const { return header_; }
  uint64_t bytes() const { return bytes_; }  // of the file
  // slices_hash() of a field with the file's contents.
  const Hash128& slices() const { return slices_; }

  // Adds the file's slices and tiles to those of a field. nothing: its ball or parameters differ from the file's. part:
  // the field's pool is full, and had no room for some.
  enum class Copied { nothing, part, all };
  Copied copy_to(Field& field) const;

  // Passes the file's contents to `visit` in fields that hold a piece each: the bricks of one direction brick, or the
  // tiles of one part of the coverage table. Memory stays small, however many equal bricks a small file stands for.
  void visit_pieces(const std::function<void(const Field&)>& visit) const;

 private:
  // Of Grids::origins, and of the coverage grid's slots. False if the field's pool fills up first.
  bool copy_bricks(Field& field, size_t first, size_t end) const;
  bool copy_tiles(Field& field, size_t first, size_t end) const;
  struct Grids;
  FieldFileHeader header_;
  uint64_t bytes_ = 0;
  Hash128 slices_;
  std::unique_ptr<Grids> grids_;
};

// Hash of which slices of which layer are finished: fields of one identity with equal hashes hold the same cells.
Hash128 slices_hash(const Field& field);

// Writes the finished slices of `field` under a temporary name that is then renamed to `path`. Unchecked: `identity`
// belongs to the field. Throws Error if the file cannot be written.
void save_field(const Field& field, const FieldIdentity& identity, const std::string& path);

// The same for the union of fields of one identity and ball; a slice that several have is taken from the first.
void save_fields(std::span<const Field* const> fields, const FieldIdentity& identity, const std::string& path);

struct LoadedField {
  Hash128 slices;      // FieldFile::slices() of the file
  bool whole = false;  // else the field's pool had no room for all of it
};

// Loads `path` into `field`. Throws FieldFileError, with the field unchanged, for whatever the constructor of FieldFile
// refuses and for a file of another identity or ball.
LoadedField load_field(Field& field, const FieldIdentity& identity, const std::string& path);

}  // namespace fieldtrace
