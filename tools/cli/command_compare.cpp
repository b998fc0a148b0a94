// `fieldtrace compare`: how far an image is from a reference.
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/image/image.h"
#include "hybrid/compare/compare.h"
#include "hybrid/compare/flip.h"
#include "tools/cli/command.h"
#include "tools/cli/options.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

struct CompareArguments {
  std::string image, reference;
  std::optional<std::string> crop;
  bool json = false;
  std::optional<double> limit;
};

struct Comparison {
  ImageDifference difference;
  std::optional<double> flip, hdr_flip;  // of colour images
};

// JSON has neither infinity nor NaN: both become null.
std::string to_json(const Comparison& comparison) {
  const ImageDifference& d = comparison.difference;
  const auto number = [](const std::optional<double>& v) {
    return v && std::isfinite(*v) ? nlohmann::ordered_json(*v) : nlohmann::ordered_json();
  };
  const nlohmann::ordered_json j = {
      {"rmse", d.rmse},
      {"relmse", d.relmse},
      {"psnr", number(d.psnr)},
      {"mean_relative", d.mean_relative},
      {"bias", d.bias},
      {"worst_block", {{"rmse", d.worst_block_rmse}, {"x", d.worst_block_x}, {"y", d.worst_block_y}}},
      {"flip", number(comparison.flip)},
      {"hdr_flip", number(comparison.hdr_flip)},
      {"not_finite", d.not_finite}};
  return j.dump(2) + "\n";
}

std::string to_text(const Comparison& comparison) {
  const ImageDifference& d = comparison.difference;
  std::string text = fmt::format(
      "rmse           {:.6g}\nrelmse         {:.6g}\npsnr           {:.2f} dB\nmean relative  {:.6g}\n"
      "bias           {:+.6g}\nworst block    {:.6g} (16x16 pixels at {}, {})\n",
      d.rmse, d.relmse, d.psnr, d.mean_relative, d.bias, d.worst_block_rmse, d.worst_block_x, d.worst_block_y);
  if (comparison.flip) text += fmt::format("flip           {:.6g}\n", *comparison.flip);
  if (comparison.hdr_flip) text += fmt::format("hdr flip       {:.6g}\n", *comparison.hdr_flip);
  if (d.not_finite > 0) text += fmt::format("not finite     {} values\n", d.not_finite);
  return text;
}

Comparison compare_named(const CompareArguments& arguments, const Image& image, const std::optional<Rect>& window) {
  const Image reference = read_image(arguments.reference);
  try {
    Comparison c{compare_images(image, reference, window), {}, {}};
    if (has_colour(image) && has_colour(reference)) {
      const Rect part = window.value_or(Rect{0, 0, image.width, image.height});
      const Image a = cropped(image, part), b = cropped(reference, part);
      c.flip = ldr_flip(a, b).mean;
      c.hdr_flip = hdr_flip(a, b).mean;
    }
    return c;
  } catch (const Error& e) {
    throw Error({arguments.image}, "cannot be compared with " + arguments.reference + ": " + e.what());
  }
}

int run_compare(const CompareArguments& arguments) {
  const Image image = read_image(arguments.image);
  std::optional<Rect> window;
  if (arguments.crop) window = parse_crop(*arguments.crop, {0, 0, image.width, image.height}, "image");
  const Comparison comparison = compare_named(arguments, image, window);
  const ImageDifference& d = comparison.difference;
  fmt::print("{}", arguments.json ? to_json(comparison) : to_text(comparison));
  // Flushed before anything goes to stderr.
  const std::string failure = flush_standard_output();
  if (!failure.empty()) throw Error(standard_output_message(failure));
  // Not `rmse > limit`: an image with NaN must fail.
  if (arguments.limit && !(d.rmse <= *arguments.limit)) {
    throw Error({arguments.image}, fmt::format("rmse {:.6g} against {} is above the limit {:.6g}", d.rmse,
                                               arguments.reference, *arguments.limit));
  }
  return k_exit_success;
}

}  // namespace

void add_compare_command(CommandLine& line) {
  const auto arguments = std::make_shared<CompareArguments>();
  CLI::App& command = *line.app.add_subcommand("compare", "Measure the difference of two images");
  command.add_option("image", arguments->image, "Image to judge")->required()->type_name("IMAGE");
  command.add_option("reference", arguments->reference, "Image to judge it by")->required()->type_name("REFERENCE");
  command
      .add_option_function<std::string>(
          "--crop", [arguments](const std::string& text) { arguments->crop = text; },
          "Pixels to compare (default: all)")
      ->type_name("X,Y,W,H");
  command.add_flag("--json", arguments->json, "Print JSON");
  command
      .add_option_function<double>(
          "--fail-above", [arguments](const double& limit) { arguments->limit = limit; },
          "Exit with 1 if the rmse is above this")
      ->check(number_between(0.0, std::numeric_limits<double>::max()))
      ->type_name("RMSE");
  command.callback([arguments, &line] { line.action = [arguments] { return run_compare(*arguments); }; });
}

}  // namespace fieldtrace
