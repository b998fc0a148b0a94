#include "core/loader/scene_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>

#include "core/io/number_text.h"
#include "core/loader/scene_transforms.h"

namespace fieldtrace {
namespace {

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

std::string format_number(double value) {
  char buffer[32];
  return std::string(buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr);
}

void check_range(double value, const Range& range, const std::string& name, const SourceLocation& where) {
  const double rounded = double(float(value));
  if (range.lower_excluded ? rounded > range.lower : rounded >= range.lower)
    if (rounded <= range.upper) return;
  std::string allowed;
  if (std::isfinite(range.lower))
    allowed = (range.lower_excluded ? "greater than " : "at least ") + format_number(range.lower);
  if (std::isfinite(range.upper))
    allowed += (allowed.empty() ? "" : " and ") + ("at most " + format_number(range.upper));
  throw Error(where, "'" + name + "' is " + format_number(value) + " but must be " + allowed);
}

}  // namespace

double parse_number(const std::string& text, const SourceLocation& where) {
  const std::vector<double> numbers = parse_numbers(text, where);
  if (numbers.size() != 1) throw Error(where, "'" + text + "' is not a number; write one, such as 0.5");
  return numbers[0];
}

std::vector<double> parse_numbers(const std::string& text, const SourceLocation& where) {
  std::vector<double> result;
  const auto separates = [](char c) { return is_space(c) || c == ','; };
  const char *at = text.data(), *const end = at + text.size();
  while (true) {
    while (at != end && separates(*at)) ++at;
    if (at == end) return result;
    const char* stop = std::find_if(at, end, separates);
    const std::string token(at, stop);
    const std::optional<double> value = parse_double(token);
    if (!value) throw Error(where, "'" + token + "' is not a number; write one, such as 0.5");
    if (std::isnan(*value) || token.find_first_of("nN") != std::string::npos)
      throw Error(where, "'" + token + "' is not a finite number");
    if (std::abs(*value) > double(std::numeric_limits<float>::max()))
      throw Error(where, "'" + token + "' is too large for single precision");
    result.push_back(*value);
    at = stop;
  }
}

Properties::Properties(const SceneNode& node, const SceneTree& tree, const Diagnostics& diagnostics)
    : node_(node), tree_(tree), diagnostics_(diagnostics) {
  std::set<std::string> names;
  for (const SceneNode& child : node.children)
    if (!child.name.empty() && !names.insert(child.name).second)
      throw Error(child.where, "the property '" + child.name + "' is given twice; remove one");
}

const SceneNode& Properties::resolve(const SceneNode& child) const {
  if (child.tag != "ref") return child;
  const auto found = tree_.ids.find(child.required("id"));
  if (found == tree_.ids.end()) throw Error(child.where, "no object has the id '" + child.id + "'; check its spelling");
  return *found->second;
}

const SceneNode* Properties::find(const std::string& name) {
  for (const SceneNode& child : node_.children)
    if (child.name == name) {
      used_.insert(&child);
      return &resolve(child);
    }
  return nullptr;
}

SourceLocation Properties::where(const std::string& name) const {
  for (const SceneNode& child : node_.children)
    if (child.name == name) return child.where;
  return node_.where;
}

bool Properties::has(const std::string& name) const {
  return std::any_of(node_.children.begin(), node_.children.end(),
                     [&](const SceneNode& child) { return child.name == name; });
}

const SceneNode* Properties::find_tagged(const std::string& name, std::initializer_list<const char*> tags) {
  const SceneNode* child = find(name);
  if (!child) return nullptr;
  for (const char* tag : tags)
    if (child->tag == tag) return child;
  throw Error(child->where, "'" + name + "' is a <" + child->tag + "> but must be a <" + *tags.begin() + ">");
}

double Properties::number(const std::string& name, double missing, const Range& range) {
  const SceneNode* child = find_tagged(name, {"float", "integer"});
  if (!child) return missing;
  const double value = parse_number(child->required("value"), child->where);
  check_range(value, range, name, child->where);
  return value;
}

int Properties::integer(const std::string& name, int missing, int lower, int upper) {
  const SceneNode* child = find_tagged(name, {"integer"});
  if (!child) return missing;
  const double value = parse_number(child->required("value"), child->where);
  if (value != std::floor(value))
    throw Error(child->where, "'" + name + "' is " + format_number(value) + " but must be a whole number");
  if (value < lower || value > upper)
    throw Error(child->where, "'" + name + "' is " + format_number(value) + " but must lie between " +
                                  std::to_string(lower) + " and " + std::to_string(upper));
  return int(value);
}

bool Properties::boolean(const std::string& name, bool missing) {
  const SceneNode* child = find_tagged(name, {"boolean"});
  if (!child) return missing;
  std::string text = child->required("value");
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (text != "true" && text != "false")
    throw Error(child->where, "'" + name + "' is '" + text + "' but must be true or false");
  return text == "true";
}

std::string Properties::string(const std::string& name, const std::string& missing) {
  const SceneNode* child = find_tagged(name, {"string"});
  return child ? child->required("value") : missing;
}

std::string Properties::choice(const std::string& name, const std::string& missing,
                               std::initializer_list<const char*> choices) {
  std::string value = string(name, missing);
  if (std::find(choices.begin(), choices.end(), value) != choices.end()) return value;
  throw Error(where(name), fmt::format("'{}' is '{}' but must be one of {}", name, value, fmt::join(choices, ", ")));
}

DVec3 Properties::point(const std::string& name, const DVec3& missing) {
  const SceneNode* child = find_tagged(name, {"point", "vector"});
  if (!child) return missing;
  const char* const axes[] = {"x", "y", "z"};
  if (const std::string* value = child->attribute("value")) {
    const std::vector<double> v = parse_numbers(*value, child->where);
    for (const char* axis : axes)
      if (child->attribute(axis))
        throw Error(child->where, "'" + name + "' has both value and x, y, z; use one of them");
    if (v.size() == 1) return DVec3(v[0]);
    if (v.size() != 3) throw Error(child->where, "'" + name + "' needs 3 numbers, not " + std::to_string(v.size()));
    return {v[0], v[1], v[2]};
  }
  DVec3 result;
  for (int i = 0; i < 3; ++i) result[i] = parse_number(child->required(axes[i]), child->where);
  return result;
}

DAffine Properties::transform(const std::string& name) {
  const SceneNode* child = find_tagged(name, {"transform"});
  return child ? parse_transform(*child, diagnostics_) : DAffine(1.0);
}

Rgb Properties::colour(const std::string& name, const Rgb& missing, ColourRole role) {
  const SceneNode* child = find(name);
  if (!child) return missing;
  if (child->tag == "texture")
    throw Error(child->where, "a texture for '" + name + "' is not available yet; give a colour");
  return parse_colour(*child, role, diagnostics_);
}

std::vector<const SceneNode*> Properties::objects(const std::string& tag) {
  std::vector<const SceneNode*> result;
  for (const SceneNode& child : node_.children) {
    // A property that was already looked up by name is not a nested object too.
    if (used_.count(&child)) continue;
    const SceneNode& object = resolve(child);
    if (object.tag != tag) continue;
    used_.insert(&child);
    result.push_back(&object);
  }
  return result;
}

const SceneNode* Properties::object(const std::string& tag) {
  const std::vector<const SceneNode*> found = objects(tag);
  if (found.size() > 1)
    throw Error(found[1]->where, "<" + node_.tag + "> has two <" + tag + ">; one is used, so remove the other");
  return found.empty() ? nullptr : found[0];
}

void Properties::ignore(std::initializer_list<const char*> names) {
  for (const char* name : names)
    for (const SceneNode& child : node_.children)
      if (child.name == name) used_.insert(&child);
}

void Properties::finish() const {
  for (const SceneNode& child : node_.children) {
    if (used_.count(&child)) continue;
    const SceneNode& object = resolve(child);
    const std::string owner =
        "<" + node_.tag + (node_.type.empty() ? std::string() : " type=\"" + node_.type + "\"") + ">";
    if (child.name.empty())
      diagnostics_.unknown(child.where, "<" + object.tag + "> has no meaning inside " + owner + ", ignored");
    else
      diagnostics_.unknown(child.where, "unknown property '" + child.name + "' of " + owner + ", ignored");
  }
}

}  // namespace fieldtrace
