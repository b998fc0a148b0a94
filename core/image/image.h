// Images in memory and on disk (EXR, PNG and whatever else OpenImageIO reads).
//
// Memory layout: interleaved float channels, row 0 at the top. Values are linear radiance unless the channel is named
// as an AOV. Thread-safety: a value; the functions may be called from any thread.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
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
  // Index of a channel by name, or -1.
  int channel_index(const std::string& name) const;
};

// Indices of the channels R, G and B; nothing if one is missing.
std::optional<std::array<int, 3>> colour_channels(const Image& image);
// The image with these channels of it, in this order.
Image select_channels(const Image& image, std::span<const size_t> channels);

struct ImageWriteOptions {
  // EXR: 16-bit half (else 32-bit float). The layers depth, position and object are always 32-bit float.
  bool half = true;
  float exposure = 0.0f;                        // PNG: stops (EV) applied before the sRGB curve
  std::map<std::string, std::string> metadata;  // EXR header strings: command, seed, spp, version
};

// Writes `image` in the format given by the file name's extension (.exr, .png). EXR keeps every channel in one
// multi-layer part, with finite values clamped to the range of half; PNG takes channels R, G, B, encoded as 8-bit sRGB
// (NaN and negative values become 0). The file is written under a temporary name in the same folder and renamed into
// place. Throws Error if it cannot be written.
void write_image(const std::string& path, const Image& image, const ImageWriteOptions& options = {});

// Throws Error, as write_image would, if the extension is neither .exr nor .png or the file cannot be written now.
// Leaves nothing behind; to be called before long work starts.
void require_image_writable(const std::string& path);
// Throws Error if the format of `path` cannot hold so many pixels: PNG holds less than 2^32 bytes of them.
void require_image_size(const std::string& path, int width, int height);

struct ImageReadOptions {
  bool linearise = true;  // decode integers from sRGB; false: the stored values divided by their largest
  std::map<std::string, std::string>* metadata = nullptr;  // if given, gets the header's strings (EXR)
};

// Reads every channel of the file's first image as float. Colour channels stored as integers (of 8 or 16 bits) are
// taken to be sRGB and are linearised, as in Mitsuba; floats are not, nor is alpha ("A"). Colours are not premultiplied
// by alpha. Throws Error naming the path and the reason.
Image read_image(const std::string& path, const ImageReadOptions& options = {});

// The sRGB transfer curve (IEC 61966-2-1) for values in [0, 1]. The encoder clamps to [0, 1]; NaN becomes 0.
float srgb_encode(float linear);
float srgb_decode(float encoded);

}  // namespace fieldtrace
