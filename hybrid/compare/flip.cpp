#include "hybrid/compare/flip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/glm.hpp>
#include <limits>

#include "core/platform/error.h"
#include "core/platform/parallel.h"

namespace fieldtrace {

namespace {

using glm::dmat3;
using glm::dvec3;

// Parameters of the paper.
constexpr double k_colour_exponent = 0.7;     // q_c, section 4.1.3
constexpr double k_colour_knee = 0.4;         // p_c
constexpr double k_colour_knee_error = 0.95;  // p_t
constexpr double k_feature_width = 0.082;     // w, degrees, section 4.2
constexpr double k_feature_exponent = 0.5;    // q_f
constexpr double k_filter_reach = 3.0;        // standard deviations of all filters
constexpr double k_pi = 3.14159265358979323846;

// Contrast sensitivity in space: a sum of two Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b), x in degrees (Table 1).
struct Sensitivity {
  double a1, b1, a2, b2;
};
constexpr Sensitivity k_achromatic = {1.0, 0.0047, 0.0, 1e-5};
constexpr Sensitivity k_red_green = {1.0, 0.0053, 0.0, 1e-5};
constexpr Sensitivity k_blue_yellow = {34.1, 0.04, 13.5, 0.025};

// Tone mapping of HDR-FLIP: Narkowicz' fit of ACES behind the exposure 0.6, (a x^2 + b x) / (c x^2 + d x + e).
constexpr double k_tone_a = 0.36 * 2.51, k_tone_b = 0.6 * 0.03;
constexpr double k_tone_c = 0.36 * 2.43, k_tone_d = 0.6 * 0.59, k_tone_e = 0.14;
constexpr double k_tone_bright = 0.85;  // what the brightest and the median pixel are mapped to

// From linear sRGB to XYZ, by the chromaticities of its primaries and its white (IEC 61966-2-1).
dmat3 xyz_of_rgb() {
  const auto xyz = [](double x, double y) { return dvec3(x / y, 1.0, (1.0 - x - y) / y); };
  const dmat3 primaries(xyz(0.64, 0.33), xyz(0.30, 0.60), xyz(0.15, 0.06));
  const dvec3 share = glm::inverse(primaries) * xyz(0.3127, 0.3290);
  return dmat3(primaries[0] * share[0], primaries[1] * share[1], primaries[2] * share[2]);
}

struct ColourSpace {
  dmat3 to_xyz = xyz_of_rgb();
  dvec3 white = to_xyz * dvec3(1.0);
  dmat3 to_relative_xyz = dmat3(1.0 / white.x, 0, 0, 0, 1.0 / white.y, 0, 0, 0, 1.0 / white.z) * to_xyz;
  dmat3 to_rgb = glm::inverse(to_relative_xyz);

  // YCxCz, a linear form of CIELAB (section 4.1.1).
  dvec3 ycxcz(const dvec3& rgb) const {
    const dvec3 t = to_relative_xyz * rgb;
    return {116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z)};
  }
  dvec3 rgb_of_ycxcz(const dvec3& c) const {
    const double y = (c.x + 16.0) / 116.0;
    return to_rgb * dvec3(y + c.y / 500.0, y, y - c.z / 200.0);
  }
  // CIELAB, its colours adjusted to luminance by Hunt (section 4.1.2).
  dvec3 hunt_lab(const dvec3& rgb) const {
    constexpr double k_delta = 6.0 / 29.0;
    const auto f = [](double t) {
      return t > k_delta * k_delta * k_delta ? std::cbrt(t) : t / (3.0 * k_delta * k_delta) + 4.0 / 29.0;
    };
    const dvec3 t = to_relative_xyz * rgb;
    const double y = f(t.y), luminance = 116.0 * y - 16.0;
    return {luminance, 0.01 * luminance * 500.0 * (f(t.x) - y), 0.01 * luminance * 200.0 * (y - f(t.z))};
  }
};

// The distance HyAB.
double hyab(const dvec3& a, const dvec3& b) {
  const dvec3 d = a - b;
  return std::abs(d.x) + std::hypot(d.y, d.z);
}

struct Plane {
  int width = 0, height = 0;
  std::vector<float> values;

  Plane(int w, int h) : width(w), height(h), values(size_t(w) * h) {}
  float* row(int y) { return &values[size_t(y) * width]; }
  const float* row(int y) const { return &values[size_t(y) * width]; }
};

// Weights at -radius ... radius.
struct Filter {
  std::vector<float> weights;

  template <class F>
  Filter(int radius, const F& f) {
    for (int x = -radius; x <= radius; ++x) weights.push_back(float(f(x)));
  }
  int radius() const { return int(weights.size() / 2); }
  // So that the positive weights sum to 1 and the negative ones to -1.
  Filter& normalise() {
    double positive = 0.0, negative = 0.0;
    for (const float w : weights) (w > 0.0f ? positive : negative) += w;
    for (float& w : weights) w = float(w / (w > 0.0f ? positive : -negative));
    return *this;
  }
};

// Filters the rows by `across` and then the columns by `down`. Beyond the border the border is repeated.
Plane filtered(const Plane& in, const Filter& across, const Filter& down) {
  const int width = in.width, height = in.height;
  Plane rows(width, height), out(width, height);
  parallel_for(size_t(height), [&](size_t y) {
    const float* from = in.row(int(y));
    float* to = rows.row(int(y));
    const int radius = across.radius();
    std::vector<float> padded(size_t(width + 2 * radius));
    for (int x = -radius; x < width + radius; ++x) padded[size_t(x + radius)] = from[std::clamp(x, 0, width - 1)];
    for (int k = 0; k <= 2 * radius; ++k) {
      const float weight = across.weights[size_t(k)];
      for (int x = 0; x < width; ++x) to[x] += weight * padded[size_t(x + k)];
    }
  });
  parallel_for(size_t(height), [&](size_t y) {
    float* to = out.row(int(y));
    const int radius = down.radius();
    for (int k = -radius; k <= radius; ++k) {
      const float* from = rows.row(std::clamp(int(y) + k, 0, height - 1));
      const float weight = down.weights[size_t(k + radius)];
      for (int x = 0; x < width; ++x) to[x] += weight * from[x];
    }
  });
  return out;
}

// `in` filtered by a sum of two Gaussians in two dimensions, of which each is a product of two in one.
Plane filtered_by_sensitivity(const Plane& in, const Sensitivity& s, double pixels_per_degree) {
  // One radius for all, that of the widest Gaussian.
  const int radius =
      int(std::ceil(k_filter_reach * std::sqrt(k_blue_yellow.b1 / (2.0 * k_pi * k_pi)) * pixels_per_degree));
  const auto gaussian = [&](double b) {
    return [=](int x) { return std::exp(-k_pi * k_pi * double(x) * x / (pixels_per_degree * pixels_per_degree * b)); };
  };
  const auto sum = [&](double b) {
    double all = 0.0;
    for (int x = -radius; x <= radius; ++x) all += gaussian(b)(x);
    return all;
  };
  const double m1 = s.a1 * std::sqrt(k_pi / s.b1) * sum(s.b1) * sum(s.b1);
  const double m2 = s.a2 * std::sqrt(k_pi / s.b2) * sum(s.b2) * sum(s.b2);
  const Filter first = Filter(radius, gaussian(s.b1)).normalise();
  Plane out = filtered(in, first, first);
  if (s.a2 == 0.0) return out;
  const Filter second = Filter(radius, gaussian(s.b2)).normalise();
  const Plane other = filtered(in, second, second);
  for (size_t i = 0; i < out.values.size(); ++i) {
    out.values[i] = float((m1 * out.values[i] + m2 * other.values[i]) / (m1 + m2));
  }
  return out;
}

// What the eye sees of one image: its filtered colours in CIELAB, and how much of an edge and of a point each pixel is.
struct Seen {
  Plane luminance, a, b, edge, point;
};

// rgb(i): the linear colour of pixel i, in [0, 1].
template <class Colours>
Seen see(int width, int height, const ColourSpace& space, double pixels_per_degree, const Colours& rgb) {
  Seen seen{Plane(width, height), Plane(width, height), Plane(width, height), Plane(width, height),
            Plane(width, height)};
  Plane grey(width, height);
  parallel_for(size_t(height), [&](size_t y) {
    for (size_t i = y * size_t(width); i < (y + 1) * size_t(width); ++i) {
      const dvec3 c = space.ycxcz(rgb(i));
      seen.luminance.values[i] = float(c.x), seen.a.values[i] = float(c.y), seen.b.values[i] = float(c.z);
      grey.values[i] = float((c.x + 16.0) / 116.0);
    }
  });
  const Plane y = filtered_by_sensitivity(seen.luminance, k_achromatic, pixels_per_degree);
  const Plane cx = filtered_by_sensitivity(seen.a, k_red_green, pixels_per_degree);
  const Plane cz = filtered_by_sensitivity(seen.b, k_blue_yellow, pixels_per_degree);

  // Derivatives of a Gaussian whose width is that of what the eye sees as a feature (section 4.2).
  const double deviation = 0.5 * k_feature_width * pixels_per_degree;
  const int radius = int(std::ceil(k_filter_reach * deviation));
  const auto g = [&](int x) { return std::exp(-double(x) * x / (2.0 * deviation * deviation)); };
  const Filter smooth = Filter(radius, g).normalise();
  const Filter edge = Filter(radius, [&](int x) { return -x * g(x); }).normalise();
  const Filter point =
      Filter(radius, [&](int x) { return (double(x) * x / (deviation * deviation) - 1.0) * g(x); }).normalise();
  const Plane edge_x = filtered(grey, edge, smooth), edge_y = filtered(grey, smooth, edge);
  const Plane point_x = filtered(grey, point, smooth), point_y = filtered(grey, smooth, point);

  parallel_for(size_t(height), [&](size_t row) {
    for (size_t i = row * size_t(width); i < (row + 1) * size_t(width); ++i) {
      const dvec3 shown = space.rgb_of_ycxcz({y.values[i], cx.values[i], cz.values[i]});
      const dvec3 lab = space.hunt_lab(glm::clamp(shown, 0.0, 1.0));
      seen.luminance.values[i] = float(lab.x), seen.a.values[i] = float(lab.y), seen.b.values[i] = float(lab.z);
      seen.edge.values[i] = std::hypot(edge_x.values[i], edge_y.values[i]);
      seen.point.values[i] = std::hypot(point_x.values[i], point_y.values[i]);
    }
  });
  return seen;
}

// The errors of all pixels (sections 4.1.3, 4.2 and 5), merged into `errors` by their maximum.
void add_errors(const Seen& image, const Seen& reference, const ColourSpace& space, std::vector<float>& errors) {
  const double most =
      std::pow(hyab(space.hunt_lab({0.0, 1.0, 0.0}), space.hunt_lab({0.0, 0.0, 1.0})), k_colour_exponent);
  const double knee = k_colour_knee * most;
  const auto lab = [](const Seen& s, size_t i) { return dvec3(s.luminance.values[i], s.a.values[i], s.b.values[i]); };
  const size_t width = size_t(image.edge.width);
  parallel_for(size_t(image.edge.height), [&](size_t y) {
    for (size_t i = y * width; i < (y + 1) * width; ++i) {
      const double distance = std::pow(hyab(lab(image, i), lab(reference, i)), k_colour_exponent);
      const double colour = distance < knee
                                ? distance * k_colour_knee_error / knee
                                : k_colour_knee_error + (distance - knee) / (most - knee) * (1.0 - k_colour_knee_error);
      const double edge = std::abs(double(image.edge.values[i]) - double(reference.edge.values[i]));
      const double point = std::abs(double(image.point.values[i]) - double(reference.point.values[i]));
      const double feature = std::pow(std::max(edge, point) / std::sqrt(2.0), k_feature_exponent);
      // Rounding alone takes either beyond 1.
      const double error = std::pow(std::min(colour, 1.0), 1.0 - std::min(feature, 1.0));
      errors[i] = std::max(errors[i], float(error));
    }
  });
}

// The colours of an image, without its other channels; 0 where a value is not finite.
class Colours {
 public:
  explicit Colours(const Image& image) : image_(image), channels_(colour_channels(image).value()) {}
  dvec3 operator()(size_t i) const {
    const float* p = &image_.data[i * image_.channel_count()];
    const dvec3 c = {p[channels_[0]], p[channels_[1]], p[channels_[2]]};
    return std::isfinite(c.x + c.y + c.z) ? c : dvec3(0.0);
  }
  bool finite() const {
    for (size_t i = 0; i < size_t(image_.width) * size_t(image_.height); ++i) {
      for (const int c : channels_) {
        if (!std::isfinite(image_.data[i * image_.channel_count() + size_t(c)])) return false;
      }
    }
    return true;
  }

 private:
  const Image& image_;
  std::array<int, 3> channels_;
};

void require_colours(const Image& image) {
  if (image.width <= 0 || image.height <= 0) throw Error("there are no pixels to compare");
  if (!colour_channels(image)) throw Error("FLIP compares the channels R, G and B, and an image lacks one");
}

void require_comparable(const Image& image, const Image& reference) {
  require_colours(image);
  require_colours(reference);
  if (image.width != reference.width || image.height != reference.height) {
    throw Error("FLIP compares images of one size");
  }
}

dvec3 displayed(const dvec3& c) {
  return {std::clamp(c.x, 0.0, 1.0), std::clamp(c.y, 0.0, 1.0), std::clamp(c.z, 0.0, 1.0)};
}

dvec3 tone_mapped(const dvec3& c) {
  const dvec3 x = {std::max(c.x, 0.0), std::max(c.y, 0.0), std::max(c.z, 0.0)};
  return displayed((k_tone_a * x * x + k_tone_b * x) / (k_tone_c * x * x + k_tone_d * x + k_tone_e));
}

FlipMap new_map(const Image& image) {
  FlipMap map{image.width, image.height, {}, 0.0};
  map.errors.assign(size_t(image.width) * size_t(image.height), 0.0f);
  return map;
}

void set_mean(FlipMap& map, bool finite) {
  double sum = 0.0;
  for (const float e : map.errors) sum += e;
  map.mean = finite ? sum / double(map.errors.size()) : std::nan("");
}

}  // namespace

FlipMap ldr_flip(const Image& image, const Image& reference, double pixels_per_degree) {
  require_comparable(image, reference);
  const ColourSpace space;
  const Colours a(image), b(reference);
  FlipMap map = new_map(image);
  const auto seen = [&](const Colours& colours) {
    return see(image.width, image.height, space, pixels_per_degree, [&](size_t i) { return displayed(colours(i)); });
  };
  add_errors(seen(a), seen(b), space, map.errors);
  set_mean(map, a.finite() && b.finite());
  return map;
}

FlipExposures flip_exposures(const Image& reference) {
  require_colours(reference);
  const Colours colours(reference);
  const ColourSpace space;
  std::vector<double> luminances(size_t(reference.width) * size_t(reference.height));
  for (size_t i = 0; i < luminances.size(); ++i) {
    luminances[i] = (space.to_xyz * colours(i)).y;
  }
  // Of an even number the upper median, as in the authors' evaluator; likewise the least luminance.
  const auto median = luminances.begin() + std::ptrdiff_t(luminances.size() / 2);
  std::nth_element(luminances.begin(), median, luminances.end());
  const double least = std::numeric_limits<float>::epsilon();
  const double middle = std::max(*median, least);
  const double most = std::max(*std::max_element(luminances.begin(), luminances.end()), least);
  // The luminance that is mapped to k_tone_bright: the positive root of a quadratic.
  const double a = k_tone_a - k_tone_bright * k_tone_c, b = k_tone_b - k_tone_bright * k_tone_d;
  const double c = -k_tone_bright * k_tone_e;
  const double bright = (-b + std::sqrt(b * b - 4.0 * a * c)) / (2.0 * a);
  FlipExposures exposures = {std::log2(bright / most), std::log2(bright / middle), 1};
  if (exposures.stop > exposures.start) {
    exposures.count = std::max(2, int(std::ceil(exposures.stop - exposures.start)));
  }
  return exposures;
}

FlipMap hdr_flip(const Image& image, const Image& reference, const std::optional<FlipExposures>& exposures,
                 double pixels_per_degree) {
  require_comparable(image, reference);
  const FlipExposures range = exposures.value_or(flip_exposures(reference));
  const ColourSpace space;
  const Colours a(image), b(reference);
  FlipMap map = new_map(image);
  for (int k = 0; k < range.count; ++k) {
    const double stops = range.start + (range.count > 1 ? (range.stop - range.start) * k / (range.count - 1) : 0.0);
    const double gain = std::exp2(stops);
    const auto seen = [&](const Colours& colours) {
      return see(image.width, image.height, space, pixels_per_degree,
                 [&](size_t i) { return tone_mapped(gain * colours(i)); });
    };
    add_errors(seen(a), seen(b), space, map.errors);
  }
  set_mean(map, a.finite() && b.finite());
  return map;
}

}  // namespace fieldtrace
