// Colours of scene files: <rgb>, <float> and <spectrum> to linear sRGB (parse_colour() of scene_values.h).

#include <algorithm>
#include <cmath>

#include "core/image/image.h"
#include "core/loader/scene_values.h"

namespace fieldtrace {
namespace {

// Range of the CIE 1931 tables, nm.
constexpr double k_first_wavelength = 360, k_last_wavelength = 830;
constexpr double k_wavelength_step = 1;

// Linear sRGB of the equal-energy spectrum of value 1 with Y = 1: Mitsuba's result for flat emission spectra.
const Rgb k_equal_energy_white(1.204794f, 0.948292f, 0.908916f);

struct Sample {
  double wavelength, value;
};

// One lobe of the fit: a Gaussian with separate widths on each side; `t1` and `t2` are the inverse widths, left and
// right.
double lobe(double wavelength, double centre, double t1, double t2) {
  const double t = (wavelength - centre) * (wavelength < centre ? t1 : t2);
  return std::exp(-0.5 * t * t);
}

// CIE 1931 colour matching functions by the multi-lobe fit of Wyman et al. 2013, equation 4 and listing 1.
DVec3 colour_matching(double w) {
  return {1.056 * lobe(w, 599.8, 0.0264, 0.0323) + 0.362 * lobe(w, 442.0, 0.0624, 0.0374) -
              0.065 * lobe(w, 501.1, 0.0490, 0.0382),
          0.821 * lobe(w, 568.8, 0.0213, 0.0247) + 0.286 * lobe(w, 530.9, 0.0613, 0.0322),
          1.217 * lobe(w, 437.0, 0.0845, 0.0278) + 0.681 * lobe(w, 459.0, 0.0385, 0.0725)};
}

double interpolate(const std::vector<Sample>& samples, double wavelength) {
  if (wavelength < samples.front().wavelength || wavelength > samples.back().wavelength) return 0;
  const auto next = std::lower_bound(samples.begin(), samples.end(), wavelength,
                                     [](const Sample& s, double w) { return s.wavelength < w; });
  if (next == samples.begin()) return next->value;
  const Sample &a = next[-1], &b = *next;
  return a.value + (b.value - a.value) * ((wavelength - a.wavelength) / (b.wavelength - a.wavelength));
}

// Linear sRGB of the spectrum, scaled so that a flat spectrum of value 1 over all wavelengths is (1, 1, 1).
Rgb spectrum_to_rgb(const std::vector<Sample>& samples) {
  DVec3 sum(0.0), white(0.0);
  for (double w = k_first_wavelength; w <= k_last_wavelength; w += k_wavelength_step) {
    const DVec3 xyz = colour_matching(w);
    sum += xyz * interpolate(samples, w);
    white += xyz;
  }
  // XYZ to linear sRGB (IEC 61966-2-1), by columns.
  const DMat3 to_srgb(DVec3(3.2406, -0.9689, 0.0557), DVec3(-1.5372, 1.8758, -0.2040), DVec3(-0.4986, 0.0415, 1.0570));
  return Rgb(glm::max((to_srgb * sum) / (to_srgb * white), DVec3(0.0)));
}

std::vector<Sample> parse_samples(const std::string& text, const SourceLocation& where) {
  std::string plain = text;
  std::replace(plain.begin(), plain.end(), ':', ' ');
  const std::vector<double> numbers = parse_numbers(plain, where);
  if (numbers.size() % 2 != 0 || numbers.size() < 4)
    throw Error(where, "a <spectrum> needs one number, or two or more of wavelength:value");
  std::vector<Sample> samples;
  for (size_t i = 0; i < numbers.size(); i += 2) {
    if (!samples.empty() && !(numbers[i] > samples.back().wavelength))
      throw Error(where, "the wavelengths of a <spectrum> must increase");
    samples.push_back({numbers[i], numbers[i + 1]});
  }
  return samples;
}

// "#rrggbb", 8-bit sRGB.
Rgb parse_hex(const std::string& text, const SourceLocation& where) {
  Rgb result;
  if (text.size() != 7 || text.find_first_not_of("0123456789abcdefABCDEF", 1) != std::string::npos)
    throw Error(where, "'" + text + "' is not a colour of the form #rrggbb");
  for (int i = 0; i < 3; ++i) {
    result[i] = srgb_decode(float(std::stoi(text.substr(1 + 2 * size_t(i), 2), nullptr, 16)) / 255.0f);
  }
  return result;
}

Rgb parse_rgb(const SceneNode& node) {
  const std::string& text = node.required("value");
  if (!text.empty() && text[0] == '#') return parse_hex(text, node.where);
  const std::vector<double> numbers = parse_numbers(text, node.where);
  if (numbers.size() == 1) return Rgb(float(numbers[0]));
  if (numbers.size() != 3) throw Error(node.where, "<rgb> needs one or three numbers or #rrggbb, not '" + text + "'");
  return {float(numbers[0]), float(numbers[1]), float(numbers[2])};
}

Rgb parse_spectrum(const SceneNode& node, ColourRole role, const Diagnostics& diagnostics) {
  const Rgb white = role == ColourRole::emission ? k_equal_energy_white : Rgb(1.0f);
  if (!node.type.empty()) {
    if (node.type == "d65" || node.type == "uniform") {
      Rgb result(1.0f);
      for (const SceneNode& child : node.children) {
        if ((child.tag == "float" || child.tag == "integer") && child.name == (node.type == "d65" ? "scale" : "value"))
          result *= float(parse_number(child.required("value"), child.where));
        else if (child.tag == "rgb" && child.name == "color" && node.type == "d65")
          result *= parse_rgb(child);
        else
          diagnostics.unknown(
              child.where, "unknown property '" + child.name + "' of <spectrum type=\"" + node.type + "\">, ignored");
      }
      return result;
    }
    diagnostics.unknown(node.where, "unknown spectrum type '" + node.type + "', taken to be 1");
    return white;
  }
  if (node.attribute("filename"))
    throw Error(node.where, "<spectrum filename=...> is not available yet; give its values as wavelength:value");
  const std::string& text = node.required("value");
  if (text.find(':') == std::string::npos) {
    const std::vector<double> numbers = parse_numbers(text, node.where);
    if (numbers.size() != 1)
      throw Error(node.where,
                  "a <spectrum> needs one number, or pairs of wavelength:value; use <rgb> for three numbers");
    return float(numbers[0]) * white;
  }
  diagnostics.warning(node.where,
                      "the spectrum is converted to RGB by a fit of the CIE curves; expect a few per cent off");
  const std::vector<Sample> samples = parse_samples(text, node.where);
  const Rgb rgb = spectrum_to_rgb(samples) * white;
  // Saturated reflectances lie beyond sRGB.
  const bool is_reflectance = role == ColourRole::reflectance &&
                              std::all_of(samples.begin(), samples.end(), [](const Sample& s) { return s.value <= 1; });
  return is_reflectance ? glm::min(rgb, Rgb(1.0f)) : rgb;
}

}  // namespace

bool is_colour(const SceneNode& node) {
  return node.tag == "rgb" || node.tag == "spectrum" || node.tag == "float" || node.tag == "integer";
}

Rgb parse_colour(const SceneNode& node, ColourRole role, const Diagnostics& diagnostics) {
  Rgb result;
  if (node.tag == "spectrum")
    result = parse_spectrum(node, role, diagnostics);
  else if (node.tag == "rgb")
    result = parse_rgb(node);
  else if (is_colour(node))
    result = Rgb(float(parse_number(node.required("value"), node.where)));
  else
    throw Error(node.where, "<" + node.tag + "> is not a colour; use <rgb>, <spectrum> or <float>");
  const float upper = role == ColourRole::reflectance ? 1.0f : std::numeric_limits<float>::max();
  for (int i = 0; i < 3; ++i)
    if (!(result[i] >= 0 && result[i] <= upper))
      throw Error(node.where, "'" + node.name + "' must " +
                                  (role == ColourRole::reflectance ? "lie in [0, 1]" : "not be negative") +
                                  " in each channel");
  return result;
}

}  // namespace fieldtrace
