#include "tools/report/compared_pictures.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/report/embedded_picture.h"
#include "tools/report/html.h"

namespace fieldtrace {
namespace {

constexpr const char* k_explanation = R"(<p>Pictures are shown as sRGB without exposure: linear radiance above 1 is
white. Differences are |picture - reference| of linear radiance per channel, {:g} times as strong. FLIP is what an eye
notices that alternates between picture and reference, from 67 pixels a degree (Andersson et al. 2020); HDR-FLIP is its
largest value over the exposures that show all of the reference (2021):</p>
{})";

std::string reduction(const Image& image) {
  if (std::max(image.width, image.height) <= k_most_embedded_side) return "";
  return fmt::format("<p>The pictures of {} x {} pixels are shown smaller: blocks of pixels by their means.</p>\n",
                     image.width, image.height);
}

}  // namespace

ComparedPicture compare_picture(const std::string& name, const Image& image, const Image& reference) {
  return {name, &image, compare_images(image, reference), ldr_flip(image, reference), hdr_flip(image, reference)};
}

std::string picture_figures(const std::vector<ComparedPicture>& pictures, const std::string& reference_name,
                            const Image& reference, const std::string& scratch_folder) {
  std::vector<const Image*> images;
  for (const ComparedPicture& p : pictures) images.push_back(p.image);
  const double gain = difference_gain(images, reference);
  const auto uri = [&](const Image& image) { return png_data_uri(image, scratch_folder); };
  const auto map = [&](const FlipMap& flip) { return uri(error_picture(flip.errors, flip.width, flip.height)); };

  std::string html = fmt::format(k_explanation, gain, error_scale()) + reduction(reference) + "<div class=\"g\">\n";
  for (const ComparedPicture& p : pictures) html += html_figure(uri(*p.image), p.name);
  html += html_figure(uri(reference), reference_name) + "</div>\n<div class=\"g\">\n";
  for (const ComparedPicture& p : pictures) {
    html += html_figure(uri(difference_picture(*p.image, reference, gain)),
                        fmt::format("{}: difference x {:g}, rmse {:.4g}", p.name, gain, p.difference.rmse));
  }
  html += "</div>\n<div class=\"g\">\n";
  for (const ComparedPicture& p : pictures) {
    html += html_figure(map(p.flip), fmt::format("{}: FLIP, mean {:.4f}", p.name, p.flip.mean));
  }
  html += "</div>\n<div class=\"g\">\n";
  for (const ComparedPicture& p : pictures) {
    html += html_figure(map(p.hdr_flip), fmt::format("{}: HDR-FLIP, mean {:.4f}", p.name, p.hdr_flip.mean));
  }
  return html + "</div>\n";
}

std::string compare_page(const ComparedPicture& picture, const std::string& reference_name, const Image& reference,
                         const std::string& how, const std::string& command, const std::string& version,
                         const std::string& scratch_folder) {
  const ImageDifference& d = picture.difference;
  const auto row = [](const char* name, const std::string& value, const char* meaning) {
    return std::vector<std::string>{name, meaning, value};
  };
  const auto number = [](double v) { return fmt::format("{:.6g}", v); };
  std::string body = fmt::format(
      "<h1>Two pictures compared</h1>\n<p>{} against {} as the reference, {}. Version {}, made by "
      "<code>{}</code></p>\n",
      html_text(picture.name), html_text(reference_name), html_text(how), html_text(version), html_text(command));
  body += "<h2>Figures</h2>\n<p>a: the picture, b: the reference; linear radiance of R, G and B.</p>\n" +
          html_table(
              {"figure", "definition", "value"},
              {row("rmse", number(d.rmse), "sqrt(mean((a - b)<sup>2</sup>))"),
               row("relmse", number(d.relmse), "mean((a - b)<sup>2</sup> / (b<sup>2</sup> + 0.01))"),
               row("psnr", fmt::format("{:.2f} dB", d.psnr), "20 log10(1 / rmse)"),
               row("mean relative", number(d.mean_relative), "mean(|a - b| / (|b| + 0.01))"),
               row("bias", number(d.bias), "mean(a - b) / mean(b)"),
               row("worst block", fmt::format("{:.6g} at {}, {}", d.worst_block_rmse, d.worst_block_x, d.worst_block_y),
                   "largest rmse of 16 x 16 pixels, and where"),
               row("flip", number(picture.flip.mean), "mean of the map below: 0 equal, 1 most different"),
               row("hdr flip", number(picture.hdr_flip.mean), "the same over exposures"),
               row("not finite", fmt::format("{}", d.not_finite), "values of either picture")},
              2);
  body += "<h2>Pictures</h2>\n" + picture_figures({picture}, reference_name, reference, scratch_folder);
  return html_page("Two pictures compared", body);
}

}  // namespace fieldtrace
