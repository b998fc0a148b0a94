// `fieldtrace compare`: how far an image is from a reference.
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/image/image.h"
#include "hybrid/compare/compare.h"
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

// JSON has neither infinity nor NaN: both become null.
std::string to_json(const ImageDifference& d) {
  const nlohmann::ordered_json j = {
      {"rmse", d.rmse},
      {"relmse", d.relmse},
      {"psnr", std::isfinite(d.psnr) ? nlohmann::ordered_json(d.psnr) : nlohmann::ordered_json()},
      {"mean_relative", d.mean_relative},
      {"bias", d.bias},
      {"worst_block", {{"rmse", d.worst_block_rmse}, {"x", d.worst_block_x}, {"y", d.worst_block_y}}},
      {"not_finite", d.not_finite}};
  return j.dump(2) + "\n";
}

std::string to_text(const ImageDifference& d) {
  std::string text = fmt::format(
      "rmse           {:.6g}\nrelmse         {:.6g}\npsnr           {:.2f} dB\nmean relative  {:.6g}\n"
      "bias           {:+.6g}\nworst block    {:.6g} (16x16 pixels at {}, {})\n",
      d.rmse, d.relmse, d.psnr, d.mean_relative, d.bias, d.worst_block_rmse, d.worst_block_x, d.worst_block_y);
  if (d.not_finite > 0) text += fmt::format("not finite     {} values\n", d.not_finite);
  return text;
}

ImageDifference compare_named(const CompareArguments& arguments, const Image& image,
                              const std::optional<Rect>& window) {
  const Image reference = read_image(arguments.reference);
  try {
    return compare_images(image, reference, window);
  } catch (const Error& e) {
    throw Error({arguments.image}, "cannot be compared with " + arguments.reference + ": " + e.what());
  }
}

int run_compare(const CompareArguments& arguments) {
  const Image image = read_image(arguments.image);
  std::optional<Rect> window;
  if (arguments.crop) window = parse_crop(*arguments.crop, {0, 0, image.width, image.height}, "image");
  const ImageDifference d = compare_named(arguments, image, window);
  fmt::print("{}", arguments.json ? to_json(d) : to_text(d));
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
