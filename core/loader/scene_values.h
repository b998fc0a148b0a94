// Numbers, colours and named properties of scene elements, with type and range checks.
//
// Source: Mitsuba 3 documentation, "Scene XML file format". Spectra: C. Wyman, P.-P. Sloan, P. Shirley, "Simple
// Analytic Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), 2013. Thread-safety: values and pure
// functions; a Properties belongs to one thread.
#pragma once

#include <initializer_list>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "core/loader/scene_tree.h"
#include "core/math/math.h"

namespace fieldtrace {

// One finite number that fits single precision; surrounding white space is allowed. Throws Error.
double parse_number(const std::string& text, const SourceLocation& where);
// Any number of values, separated by white space or commas. Throws Error.
std::vector<double> parse_numbers(const std::string& text, const SourceLocation& where);

// Range of a number after rounding to single precision.
struct Range {
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  bool lower_excluded = false;
};
inline constexpr Range k_positive = {0.0, std::numeric_limits<double>::infinity(), true};
inline constexpr Range k_not_negative = {0.0, std::numeric_limits<double>::infinity(), false};

// What a colour represents, which determines its white point and range.
enum class ColourRole {
  reflectance,  // [0, 1]; a flat spectrum is grey
  index,        // refractive index or absorption, not negative; a flat spectrum is grey
  emission      // not negative; a flat spectrum is the equal-energy white, as in Mitsuba
};

// The colour of a <rgb>, <float>, <integer> or <spectrum> element, linear sRGB. Throws Error.
Rgb parse_colour(const SceneNode& node, ColourRole role, const Diagnostics& diagnostics);

// True for elements that parse_colour() reads.
bool is_colour(const SceneNode& node);

// The properties and nested objects of one element. Look-ups mark what they find; finish() reports the rest. All
// look-ups throw Error for a wrong element type, a malformed value, a value out of range, a repeated name, or a
// reference to an id that does not exist.
class Properties {
 public:
  Properties(const SceneNode& node, const SceneTree& tree, const Diagnostics& diagnostics);

  // The child with that name, references resolved, or null.
  const SceneNode* find(const std::string& name);
  // Location of the property, or of the element itself if the property is absent.
  SourceLocation where(const std::string& name) const;
  bool has(const std::string& name) const;

  double number(const std::string& name, double missing, const Range& range = {});
  int integer(const std::string& name, int missing, int lower, int upper);
  bool boolean(const std::string& name, bool missing);
  std::string string(const std::string& name, const std::string& missing);
  // A string that must be one of `choices`.
  std::string choice(const std::string& name, const std::string& missing, std::initializer_list<const char*> choices);
  // <point> or <vector>.
  DVec3 point(const std::string& name, const DVec3& missing);
  DAffine transform(const std::string& name);
  Rgb colour(const std::string& name, const Rgb& missing, ColourRole role);

  // Nested objects with that tag, in order, references resolved.
  std::vector<const SceneNode*> objects(const std::string& tag);
  // The only nested object with that tag, or null. Throws Error if there are two.
  const SceneNode* object(const std::string& tag);

  // Known properties that have no effect here.
  void ignore(std::initializer_list<const char*> names);
  // Reports every child that no look-up has marked.
  void finish() const;

 private:
  const SceneNode& resolve(const SceneNode& child) const;
  const SceneNode* find_tagged(const std::string& name, std::initializer_list<const char*> tags);

  const SceneNode& node_;
  const SceneTree& tree_;
  const Diagnostics& diagnostics_;
  std::set<const SceneNode*> used_;
};

}  // namespace fieldtrace
