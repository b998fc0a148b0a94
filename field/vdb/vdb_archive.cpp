#include "field/vdb/vdb_archive.h"

#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace fieldtrace {
namespace {

// Types of the metadata that a field file has (field/file/field_vdb.cpp). OpenVDB's other types may
// reserve memory by counts that a file states.
bool is_field_metadata(const std::string& type) {
  const std::string known[] = {openvdb::StringMetadata::staticTypeName(), openvdb::Int32Metadata::staticTypeName(),
                               openvdb::Int64Metadata::staticTypeName(), openvdb::FloatMetadata::staticTypeName(),
                               openvdb::Vec3SMetadata::staticTypeName()};
  return std::find(std::begin(known), std::end(known), type) != std::end(known);
}

// Looks ahead in a stream whose whole length is known.
class Lookahead {
 public:
  explicit Lookahead(std::istream& in) : in_(in), begin_(in.tellg()) {
    in_.seekg(0, std::ios::end);
    end_ = in_.tellg();
    in_.seekg(begin_);
  }

  uint32_t word() {
    uint32_t value = 0;
    in_.read(reinterpret_cast<char*>(&value), sizeof value);
    return value;
  }
  // A length, and that many bytes.
  std::string text() {
    const uint32_t length = word();
    require(length);
    std::string bytes(length, '\0');
    in_.read(bytes.data(), std::streamsize(length));
    return bytes;
  }
  void skip_text() {
    const uint32_t length = word();
    require(length);
    in_.seekg(std::streamoff(length), std::ios::cur);
  }
  // A map of names to values, each with its type and length. `checked`: throws for types that no field file has.
  void skip_metadata(bool checked) {
    for (uint32_t left = word(); left > 0; --left) {
      skip_text();
      if (const std::string type = text(); checked && !is_field_metadata(type)) {
        OPENVDB_THROW(openvdb::IoError, "metadata of the type " << type);
      }
      skip_text();
    }
  }
  void go_back() { in_.seekg(begin_); }

 private:
  void require(uint32_t bytes) {
    if (std::streamoff(bytes) > end_ - in_.tellg()) OPENVDB_THROW(openvdb::IoError, "a length beyond the file's end");
  }

  std::istream& in_;
  std::streampos begin_, end_;
};

}  // namespace

void VdbArchive::write_file(const std::string& path, const openvdb::GridCPtrVec& grids,
                            const openvdb::MetaMap& metadata) {
  errno = 0;
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  if (out) Archive::write(out, grids, /*seekable=*/true, metadata);
  out.close();
  if (!out) throw std::runtime_error(errno ? std::strerror(errno) : "a write failed");
}

VdbContents VdbArchive::read_bytes(std::string bytes, int most_grids) {
  std::istringstream in(std::move(bytes), std::ios::binary);
  in.exceptions(std::ios::failbit | std::ios::badbit);
  readHeader(in);
  if (fileVersion() < openvdb::OPENVDB_FILE_VERSION_NODE_MASK_COMPRESSION) {
    OPENVDB_THROW(openvdb::IoError, "file format " << fileVersion() << " of OpenVDB");
  }
  openvdb::io::StreamMetadata::Ptr stream(new openvdb::io::StreamMetadata);
  openvdb::io::setStreamMetadataPtr(in, stream, /*transfer=*/false);
  setFormatVersion(in);
  setLibraryVersion(in);
  setDataCompression(in);

  VdbContents contents;
  Lookahead file_metadata(in);
  file_metadata.skip_metadata(/*checked=*/true);
  file_metadata.go_back();
  contents.metadata.readMeta(in);
  const int32_t count = readGridCount(in);
  if (count < 0 || count > most_grids) OPENVDB_THROW(openvdb::IoError, count << " grids");
  for (int32_t i = 0; i < count; ++i) {
    Lookahead descriptor(in);
    descriptor.skip_text();
    const std::string type = descriptor.text(), shared_with = descriptor.text();
    if (type != openvdb::Int32Grid::gridType() || !shared_with.empty()) {
      OPENVDB_THROW(openvdb::IoError, "a grid of the type " << type);
    }
    descriptor.go_back();
    openvdb::io::GridDescriptor grid_descriptor;
    const openvdb::GridBase::Ptr grid = grid_descriptor.read(in);
    readGridCompression(in);
    Lookahead(in).skip_metadata(/*checked=*/false);
    Lookahead transform(in);
    transform.skip_text();
    transform.go_back();
    grid->readTransform(in);
    grid->readTopology(in);
    grid->readBuffers(in);
    grid->setName(grid_descriptor.gridName());
    contents.grids.push_back(grid);
  }
  return contents;
}

}  // namespace fieldtrace
