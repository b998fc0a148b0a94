#include "hybrid/denoise/denoise.h"

#include <algorithm>
#include <cmath>

#include "core/platform/error.h"
#include "core/platform/module.h"
#include "hybrid/denoise/denoiser.h"

namespace fieldtrace {
namespace {

constexpr const char* k_albedo = "denoise_albedo";
constexpr const char* k_normal = "denoise_normal";

// Three channels, the first of which has this name. Throws Error if they are not there.
std::vector<float> three_channels(const Image& image, const std::string& name) {
  const int first = image.channel_index(name);
  if (first < 0 || size_t(first) + 3 > image.channel_count())
    throw Error("cannot denoise a picture without the channel " + name);
  std::vector<float> values;
  values.reserve(size_t(image.width) * size_t(image.height) * 3);
  for (size_t i = size_t(first); i < image.data.size(); i += image.channel_count())
    values.insert(values.end(), &image.data[i], &image.data[i] + 3);
  return values;
}

// The layer of a channel "LAYER.NAME".
std::string layer_of(const std::string& channel) { return channel.substr(0, channel.find('.')); }

bool holds(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

void require_denoiser() {
#ifndef FIELDTRACE_OIDN
  throw UsageError(
      "--denoise: this program was built without Intel Open Image Denoise; run tools/install_packages.sh --with-oidn, "
      "or "
      "install the library where CMake finds it, and build again");
#endif
}

const std::vector<std::string>& denoise_layers() {
  static const std::vector<std::string> layers = {k_albedo, k_normal};
  return layers;
}

std::string denoise(Image& image, const DenoiseOptions& options) {
  std::vector<float> colour = three_channels(image, "R"), albedo = three_channels(image, std::string(k_albedo) + ".R"),
                     normal = three_channels(image, std::string(k_normal) + ".X"), result(colour.size());
  if (colour.empty()) return {};
  std::string name;
  try {
    const auto denoiser = reinterpret_cast<Denoiser*>(module_function(k_denoiser_module, k_denoiser_function));
    denoiser({image.width, image.height, colour.data(), albedo.data(), normal.data(), result.data(), options.threads,
              options.noisy_layers},
             name);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("the denoiser failed: ") + error.what());
  }
  if (!std::all_of(result.begin(), result.end(), [](float v) { return std::isfinite(v); }))
    throw Error("the denoiser failed: " + name + " gave values that are not finite");
  const auto red = size_t(image.channel_index("R"));
  for (size_t i = 0; i < result.size() / 3; ++i)
    std::copy_n(&result[3 * i], 3, &image.data[i * image.channel_count() + red]);
  return name;
}

void drop_denoise_layers(Image& image, const std::vector<std::string>& kept) {
  std::vector<size_t> stay;
  for (size_t c = 0; c < image.channel_count(); ++c) {
    const std::string layer = layer_of(image.channels[c]);
    if (!holds(denoise_layers(), layer) || holds(kept, layer)) stay.push_back(c);
  }
  if (stay.size() < image.channel_count()) image = select_channels(image, stay);
}

}  // namespace fieldtrace
