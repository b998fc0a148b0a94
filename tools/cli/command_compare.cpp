// `fieldtrace compare`: how far an image is from a reference.
#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/image/image.h"
#include "core/io/atomic_file.h"
#include "hybrid/compare/compare.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/output_files.h"
#include "tools/cli/standard_output.h"
#include "tools/report/compared_pictures.h"

namespace fieldtrace {

namespace {

struct CompareArguments {
  std::string image, reference;
  std::string report;  // HTML page to write; empty: none
  std::optional<std::string> crop, layer;
  bool json = false;
  std::optional<double> limit;
};

// All channels of a file, or those of one layer.
Image read_channels(const std::string& path, const std::optional<std::string>& layer) {
  Image image = read_image(path);
  if (!layer) return image;
  try {
    return layer_of(image, *layer);
  } catch (const Error& e) {
    throw Error({path}, e.what());
  }
}

// Where the file's neighbours lie.
std::string folder_of(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  return folder.empty() ? "." : folder.string();
}

struct Comparison {
  ImageDifference difference;
  Image image, reference;                  // the pixels that are compared
  std::optional<ComparedPicture> picture;  // of colour images; refers to `image`
};

// JSON has neither infinity nor NaN: both become null.
std::string to_json(const Comparison& comparison) {
  const ImageDifference& d = comparison.difference;
  const std::optional<ComparedPicture>& p = comparison.picture;
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
      {"flip", number(p ? std::optional(p->flip.mean) : std::nullopt)},
      {"hdr_flip", number(p ? std::optional(p->hdr_flip.mean) : std::nullopt)},
      {"not_finite", d.not_finite}};
  return j.dump(2) + "\n";
}

std::string to_text(const Comparison& comparison) {
  const ImageDifference& d = comparison.difference;
  const std::optional<ComparedPicture>& p = comparison.picture;
  std::string text = fmt::format(
      "rmse           {:.6g}\nrelmse         {:.6g}\npsnr           {:.2f} dB\nmean relative  {:.6g}\n"
      "bias           {:+.6g}\nworst block    {:.6g} (16x16 pixels at {}, {})\n",
      d.rmse, d.relmse, d.psnr, d.mean_relative, d.bias, d.worst_block_rmse, d.worst_block_x, d.worst_block_y);
  if (p) text += fmt::format("flip           {:.6g}\nhdr flip       {:.6g}\n", p->flip.mean, p->hdr_flip.mean);
  if (d.not_finite > 0) text += fmt::format("not finite     {} values\n", d.not_finite);
  return text;
}

void compare_named(const CompareArguments& arguments, const Rect& window, Comparison& c) {
  try {
    c.difference = compare_images(c.image, c.reference, window);
    if (!colour_channels(c.image) || !colour_channels(c.reference)) {
      if (!arguments.report.empty()) throw Error("a page shows the channels R, G and B, and one lacks them");
      return;
    }
    c.image = cropped(c.image, window), c.reference = cropped(c.reference, window);
    c.picture = compare_picture(arguments.image, c.image, c.reference);
    c.picture->difference = c.difference;  // with places in the whole image
  } catch (const Error& e) {
    throw Error({arguments.image}, "cannot be compared with " + arguments.reference + ": " + e.what());
  }
}

int run_compare(const CompareArguments& arguments, const std::string& command) {
  const std::atomic<bool>* stop = nullptr;
  if (!arguments.report.empty()) {
    stop = &stop_on_interrupt();
    const OutputFile outputs[] = {{"--report", arguments.report}};
    const std::string inputs[] = {arguments.image, arguments.reference};
    require_distinct_files(outputs, inputs);
    require_writable(arguments.report);
  }

  Comparison comparison;
  comparison.image = read_channels(arguments.image, arguments.layer);
  Rect window = {0, 0, comparison.image.width, comparison.image.height};
  if (arguments.crop) window = parse_crop(*arguments.crop, window, "image");
  comparison.reference = read_channels(arguments.reference, arguments.layer);
  compare_named(arguments, window, comparison);
  const ImageDifference& d = comparison.difference;
  if (stop && *stop) return report_interrupted(arguments.report);
  if (!arguments.report.empty()) {
    const std::string how = fmt::format("{} x {} pixels from {}, {}", window.width, window.height, window.x, window.y);
    write_text_file(arguments.report,
                    compare_page(*comparison.picture, arguments.reference, comparison.reference, how, command,
                                 FIELDTRACE_VERSION, folder_of(write_target(arguments.report))));
  }
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
  command
      .add_option_function<std::string>(
          "--layer", [arguments](const std::string& name) { arguments->layer = name; },
          "Layer to compare (default: R, G and B)")
      ->type_name("NAME");
  command.add_flag("--json", arguments->json, "Print JSON");
  command.add_option("--report", arguments->report, "HTML page to write: figures, pictures, differences, FLIP maps")
      ->type_name("FILE")
      ->check(not_empty())
      ->excludes("--layer");  // a page shows colours
  command.add_option("--fail-above", arguments->limit, "Exit with 1 if the rmse is above this")
      ->check(number_between(0.0, std::numeric_limits<double>::max()))
      ->type_name("RMSE");
  command.callback(
      [arguments, &line] { line.action = [arguments, &line] { return run_compare(*arguments, line.text); }; });
}

}  // namespace fieldtrace
