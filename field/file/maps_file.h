// Direction maps in files: OpenVDB with the metadata and checksum of every field file (field/file/field_file.h).
//
// One Int32 grid, "depth", background 0: voxel (direction, y, x) holds a texel's depth (field/maps/maps_view.h) and is
// active where its line meets the object. Coverage is left out, since depths tell it. In the metadata chart is "maps",
// directions is D, plane is T, and lines are 0. Readable by vdb_print. Thread-safety: distinct paths are independent.
#pragma once

#include <cstdint>
#include <string>

#include "field/file/field_file.h"
#include "field/maps/direction_maps.h"

namespace fieldtrace {

// Unchecked: valid_map_size(size).
FieldIdentity maps_identity(const Shape& shape, const DMat3& stretch, const MapSize& size);

// Writes the file under a temporary name that is then renamed, and returns its size in bytes. Unchecked: `identity`
// belongs to the maps. Throws Error if the file cannot be written.
uint64_t save_direction_maps(const DirectionMaps& maps, const FieldIdentity& identity, const std::string& path);

// Finished maps. Throws FieldFileError for a file that is missing, damaged, of another identity or ball, or with depths
// that no bake writes.
DirectionMaps load_direction_maps(const FieldIdentity& identity, const Sphere& ball, const std::string& path);

struct MapsFileInfo {
  FieldFileHeader header;
  MapSize size;
  uint64_t hits = 0;  // of size.lines()
  uint64_t bytes_disk = 0;
  uint64_t bytes_memory = 0;  // of maps that have been loaded from the file
};

// Reads and checks the whole file. Throws FieldFileError as load_direction_maps() does.
MapsFileInfo maps_file_info(const std::string& path);

}  // namespace fieldtrace
