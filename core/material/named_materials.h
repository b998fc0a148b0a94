// Refractive indices of metals and transparent media by the names that Mitsuba's scenes use.
//
// Source: metals: measurements collected in E. Palik, "Handbook of Optical Constants of Solids" (1985-1998), and the
// SOPRA and CXRO collections, as shipped with Mitsuba 3.9.1; here as the linear sRGB values that it derives from the
// spectra (CIE 1931 integration under D65, variant scalar_rgb), so that both renderers use equal values. Media: E.
// Hecht, "Optics" (4th edition), at 589 nm and 0 to 20 degrees Celsius. Thread-safety: constant tables.
#pragma once

#include <optional>
#include <string>

#include "core/math/math.h"

namespace fieldtrace {

// eta + i k per channel, relative to vacuum.
struct ComplexIndex {
  Rgb eta, k;
};

// "none" is a perfect mirror. Names are case-sensitive, as in Mitsuba. Empty for an unknown name.
std::optional<ComplexIndex> find_metal(const std::string& name);
// Case-insensitive. Empty for an unknown name.
std::optional<float> find_refractive_index(const std::string& name);

// Comma-separated lists for messages.
std::string metal_names();
std::string refractive_index_names();

}  // namespace fieldtrace
