// What a picture depends on besides the number of its samples: what two runs must agree on for one to go on where the
// other ended.
#pragma once

#include "hybrid/film/checkpoint.h"
#include "hybrid/film/part.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// By the names of options, and of the scene's files, whose contents are hashed. Throws Error if one cannot be read.
// Scenes without files are told apart by their sizes alone.
PictureIdentity picture_identity(const Picture& picture);

// The part that a picture with a slice is, but for what the render decides.
Part part_of(const Picture& picture);

}  // namespace fieldtrace
