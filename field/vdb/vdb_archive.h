// OpenVDB's archive with safe reading and writing.
//
// OpenVDB's own io::Stream reserves whatever sizes a file states, gigabytes for a length of four bytes, and does not
// notice the file's end; its io::File ignores failed writes. Here strings and metadata are checked against the file's
// length before they are read, every read must succeed, and only grids of fields are read at all. So memory is bounded
// by the file's size: what grows most are OpenVDB's inner nodes, 8 bytes a child in memory for 2 bits on disk.
// Format: OpenVDB 10, io/Archive.cc and io/GridDescriptor.cc. Thread-safety: distinct objects are independent.
#pragma once

#include <openvdb/openvdb.h>

#include <openvdb/io/Archive.h>

#include <string>

namespace fieldtrace {

struct VdbContents {
  openvdb::MetaMap metadata;  // the file's; that of the grids is skipped
  openvdb::GridPtrVec grids;  // Int32Grids under their names, at most `most_grids`
};

class VdbArchive : public openvdb::io::Archive {
 public:
  // Writes what io::File would write. Throws std::runtime_error with the system's reason if any write to `path` fails.
  void write_file(const std::string& path, const openvdb::GridCPtrVec& grids, const openvdb::MetaMap& metadata);

  // Parses the bytes of a file. Throws std::exception for whatever write_file() does not write: other types of grids
  // and metadata, more than `most_grids`, lengths beyond the end.
  VdbContents read_bytes(std::string bytes, int most_grids);
};

}  // namespace fieldtrace
