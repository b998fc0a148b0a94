// Parts of a picture: files that each hold one slice of it (slice.h), and how they are joined.
//
// A part is an EXR of the whole picture with all of its layers in 32-bit float, black outside of the slice's tiles. Two
// strings in its header make it a part: `fieldtrace:part`, JSON that says which slice of which picture it is, and
// `fieldtrace:part_hash`, a hash of that and of the pixels. Thread-safety: values; the functions may be called from any
// thread.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/scene/scene.h"
#include "hybrid/film/checkpoint.h"
#include "hybrid/film/slice.h"

namespace fieldtrace {

struct Part {
  Slice slice;
  Rect window;                        // pixels of the film that the picture shows
  Rect traced;                        // pixels that its tiles cover, from whose corner the tiles begin
  PictureIdentity identity;           // what the picture depends on, by the names of options
  PictureIdentity decided;            // what the render decided by itself, which must be alike in all parts
  std::vector<std::string> channels;  // of the image, in its order
};

// Writes a part under a temporary name and renames it. `image` is the window's. Throws Error if it cannot be written.
void write_part(const std::string& path, const Image& image, const Part& part,
                const std::map<std::string, std::string>& metadata);

// Whether the file is a whole part, of this slice of this picture. What renders decide is not compared. Never throws
// because of what the file holds.
bool holds_part(const std::string& path, const Part& part);

struct MergedPicture {
  Image image;
  int slices = 0;
  std::map<std::string, std::string> metadata;  // the strings in the header of the first part
};

// Joins the parts of a picture. Throws Error that names every part that is missing, there twice, of another picture
// (and what differs from the picture of most parts), damaged, or no part at all.
MergedPicture merge_parts(const std::vector<std::string>& paths);

// The slice of an image file, from the strings in its header; none if it is no part.
std::optional<Slice> slice_of(const std::map<std::string, std::string>& metadata);

}  // namespace fieldtrace
