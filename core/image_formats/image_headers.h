// What the headers of image files promise, held against the files' sizes before memory is taken.
//
// Thread-safety: pure functions.
#pragma once

#include <OpenImageIO/imageio.h>

#include <stdexcept>
#include <string>

namespace fieldtrace {

// What is wrong with a file.
using Failure = std::runtime_error;

// Throws Failure if the file is a GIF or a JPEG, whatever its name, whose header promises more than the file can hold.
// To be called before OpenImageIO opens it, which allocates a GIF's canvas.
void check_own_header(const std::string& path);

// Throws Failure for dimensions that a file of this size and of OpenImageIO's `format` cannot hold.
void check_size(const std::string& path, const std::string& format, const OIIO::ImageSpec& spec);

}  // namespace fieldtrace
