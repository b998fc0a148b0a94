// Images in memory and on disk (EXR, PNG and whatever else OpenImageIO reads).
//
// Memory layout: interleaved float channels, row 0 at the top. Values are linear radiance unless a channel's
// name says otherwise (an AOV). Thread-safety: a value; the functions may be called from any thread.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace fieldtrace {

struct Image {
  int width = 0, height = 0;
  std::vector<std::string> channels;  // "R", "G", "B", or "LAYER.NAME" as in OpenEXR ("normal.X", "depth.Z")
  std::vector<float> data;            // width * height * channels.size()

  size_t channel_count() const { return channels.size(); }
  float* pixel(int x, int y) { return &data[(size_t(y) * width + x) * channels.size()]; }
  const float* pixel(int x, int y) const { return &data[(size_t(y) * width + x) * channels.size()]; }
};

struct ImageWriteOptions {
  bool half = true;                             // EXR: 16-bit half (else 32-bit float)
  float exposure = 0.0f;                        // PNG: stops (EV) applied before the sRGB curve
  std::map<std::string, std::string> metadata;  // EXR header strings: command, seed, spp, version
};

// Writes `image` in the format that the file name's ending names (.exr, .png). EXR keeps every channel in one
// multi-layer part; PNG takes channels R, G, B, encoded as 8-bit sRGB. The file is written beside its final name
// under a temporary name and renamed into place. Throws Error if it cannot be written.
void write_image(const std::string& path, const Image& image, const ImageWriteOptions& options = {});

// Reads every channel as linear float (8-bit formats are taken to be sRGB and linearised). Throws Error.
Image read_image(const std::string& path);

}  // namespace fieldtrace
