// Textures of scene files: constants, checkerboards, bitmaps (build_texture() of scene_builder.h).

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/image/image.h"
#include "core/loader/scene_builder.h"
#include "core/loader/scene_transforms.h"

namespace fieldtrace {
namespace {

// Mitsuba's `to_uv`: the 2-D part of a transform.
glm::mat3x2 parse_uv_transform(Properties& properties) {
  const DAffine t = properties.transform("to_uv");
  return glm::mat3x2(Vec2(t[0]), Vec2(t[1]), Vec2(t[3]));
}

Bitmap load_bitmap(const std::string& path, bool raw, const SourceLocation& where) {
  Image image;
  try {
    image = read_image(path, {.linearise = !raw});
  } catch (const Error& error) {
    throw Error(where, std::string("the bitmap cannot be used: ") + error.what());
  }
  const size_t channels = image.channel_count();
  if (image.width < 1 || image.height < 1 || channels < 1)
    throw Error(where, "the bitmap '" + path + "' holds no pixels");
  const auto index_of = [&](const char* name, size_t missing) {
    const auto found = std::find(image.channels.begin(), image.channels.end(), name);
    return found == image.channels.end() ? missing : size_t(found - image.channels.begin());
  };
  // Grey images have one channel, or two with alpha; one serves for all three colours.
  const bool grey = channels < 3;
  const size_t other_than_alpha = image.channels[0] == "A" && channels > 1 ? 1 : 0;
  const auto colours = colour_channels(image);
  if (!grey && !colours) {
    throw Error(where, "the bitmap '" + path + "' has no channels R, G and B, but " +
                           fmt::format("{}", fmt::join(image.channels, ", ")) + "; convert it");
  }
  const size_t red = grey ? index_of("Y", other_than_alpha) : size_t((*colours)[0]);
  const size_t green = grey ? red : size_t((*colours)[1]), blue = grey ? red : size_t((*colours)[2]);
  Bitmap bitmap;
  bitmap.width = image.width;
  bitmap.height = image.height;
  bitmap.pixels.reserve(size_t(image.width) * size_t(image.height));
  for (size_t i = 0; i < size_t(image.width) * size_t(image.height); ++i) {
    const float* p = &image.data[i * channels];
    Rgb pixel(p[red], p[green], p[blue]);
    for (int c = 0; c < 3; ++c) {
      if (!std::isfinite(pixel[c]))
        throw Error(where, "the bitmap '" + path + "' has a pixel that is not finite; repair the picture");
    }
    bitmap.pixels.push_back(pixel);
  }
  return bitmap;
}

// Reflectances and opacities lie in [0, 1]: values outside would break energy conservation.
void clamp_bitmap(SceneBuilder& builder, Bitmap& bitmap, const std::string& path, const SourceLocation& where) {
  size_t beyond = 0;
  for (Rgb& pixel : bitmap.pixels) {
    const Rgb clamped = glm::clamp(pixel, 0.0f, 1.0f);
    beyond += clamped != pixel;
    pixel = clamped;
  }
  if (beyond > 0) {
    builder.diagnostics.unknown(where, "the bitmap '" + path + "' has " + std::to_string(beyond) +
                                           " pixels outside [0, 1], which are cut off there; scale the picture");
  }
}

Texture parse_bitmap(SceneBuilder& builder, const SceneNode& node, Properties& properties) {
  Texture texture;
  texture.kind = TextureKind::bitmap;
  const std::string filename = properties.string("filename", "");
  if (filename.empty()) throw Error(node.where, "<texture type=\"bitmap\"> lacks its filename");
  const bool raw = properties.boolean("raw", false);
  const std::string wrap = properties.choice("wrap_mode", "repeat", {"repeat", "mirror", "clamp"});
  texture.wrap = wrap == "repeat" ? WrapMode::repeat : wrap == "mirror" ? WrapMode::mirror : WrapMode::clamp;
  texture.filter = properties.choice("filter_type", "bilinear", {"bilinear", "nearest"}) == "nearest"
                       ? TextureFilter::nearest
                       : TextureFilter::bilinear;
  texture.uv_transform = parse_uv_transform(properties);
  properties.ignore({"format", "accel"});
  const BitmapUse use = raw ? BitmapUse::raw_reflectance : BitmapUse::reflectance;
  texture.bitmap = build_bitmap(builder, builder.input_file(node, filename), use, properties.where("filename"));
  return texture;
}

Texture parse_checkerboard(Properties& properties) {
  Texture texture;
  texture.kind = TextureKind::checkerboard;
  texture.color0 = properties.colour("color0", Rgb(0.4f), ColourRole::reflectance);
  texture.color1 = properties.colour("color1", Rgb(0.2f), ColourRole::reflectance);
  texture.uv_transform = parse_uv_transform(properties);
  return texture;
}

}  // namespace

uint32_t build_bitmap(SceneBuilder& builder, const std::string& path, BitmapUse use, const SourceLocation& where) {
  const auto [found, inserted] = builder.bitmaps.emplace(std::pair(path, use), k_none);
  if (inserted) {
    Bitmap bitmap = load_bitmap(path, use == BitmapUse::raw_reflectance, where);
    if (use != BitmapUse::radiance) clamp_bitmap(builder, bitmap, path, where);
    builder.scene.bitmaps.push_back(std::move(bitmap));
    found->second = uint32_t(builder.scene.bitmaps.size() - 1);
  }
  return found->second;
}

uint32_t add_constant_texture(SceneBuilder& builder, const Rgb& value) {
  Texture texture;
  texture.color0 = value;
  builder.scene.textures.push_back(texture);
  return uint32_t(builder.scene.textures.size() - 1);
}

uint32_t build_texture(SceneBuilder& builder, Properties& properties, const std::string& name, const Rgb& missing) {
  const SceneNode* node = properties.find(name);
  if (!node) return add_constant_texture(builder, missing);
  if (is_colour(*node))
    return add_constant_texture(builder, parse_colour(*node, ColourRole::reflectance, builder.diagnostics));
  if (node->tag != "texture")
    throw Error(node->where, "'" + name + "' is a <" + node->tag + "> but must be a colour or a <texture>");
  const auto known = builder.textures.find(node);
  if (known != builder.textures.end()) return known->second;

  Texture texture;
  Properties inner = builder.properties(*node);
  if (node->type == "bitmap") {
    texture = parse_bitmap(builder, *node, inner);
  } else if (node->type == "checkerboard") {
    texture = parse_checkerboard(inner);
  } else {
    builder.diagnostics.unknown(node->where, "unknown texture type '" + node->type + "', replaced by grey 0.5");
    const uint32_t grey = add_constant_texture(builder, Rgb(0.5f));
    builder.textures[node] = grey;
    return grey;
  }
  inner.finish();
  builder.scene.textures.push_back(texture);
  const uint32_t index = uint32_t(builder.scene.textures.size() - 1);
  builder.textures[node] = index;
  return index;
}

}  // namespace fieldtrace
