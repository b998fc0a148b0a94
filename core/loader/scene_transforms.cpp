#include "core/loader/scene_transforms.h"

#include <cmath>
#include <limits>

#include "core/loader/scene_values.h"
#include "core/math/frame.h"

namespace fieldtrace {
namespace {

// The determinant of three unit columns carries a rounding error of about gamma(16) in double precision: 5 roundings of
// the determinant itself, the rest from the columns' products. Below that it cannot be told from 0.
constexpr double k_singular = 16 * 0x1p-53;

// Scene files give rotations with as few as 4 decimals: each entry is off by up to 5e-5, and a product of two columns
// by up to 2 * 3 * 5e-5. Three times that is still far from any intended scale or shear.
constexpr double k_rigid_tolerance = 1e-3;

// `value="x"`, `value="x y z"`, or the attributes x, y, z, with `missing` for those left out.
DVec3 parse_components(const SceneNode& node, double missing) {
  const bool split = node.attribute("x") || node.attribute("y") || node.attribute("z");
  if (const std::string* value = node.attribute("value")) {
    if (split) throw Error(node.where, "<" + node.tag + "> has both value and x, y, z; use one of them");
    const std::vector<double> numbers = parse_numbers(*value, node.where);
    if (numbers.size() == 1) return DVec3(numbers[0]);
    if (numbers.size() == 3) return {numbers[0], numbers[1], numbers[2]};
    throw Error(node.where, "<" + node.tag + "> needs 1 or 3 numbers, not " + std::to_string(numbers.size()));
  }
  DVec3 result(missing);
  const char* const axes[] = {"x", "y", "z"};
  for (int i = 0; i < 3; ++i)
    if (const std::string* text = node.attribute(axes[i])) result[i] = parse_number(*text, node.where);
  return result;
}

DVec3 parse_triple(const SceneNode& node, const std::string& text) {
  const std::vector<double> numbers = parse_numbers(text, node.where);
  if (numbers.size() != 3) throw Error(node.where, "'" + text + "' should be three numbers");
  return {numbers[0], numbers[1], numbers[2]};
}

DAffine parse_matrix(const SceneNode& node) {
  const std::vector<double> m = parse_numbers(node.required("value"), node.where);
  if (m.size() != 16 && m.size() != 9)
    throw Error(node.where, "<matrix> needs 16 or 9 numbers, not " + std::to_string(m.size()));
  const size_t n = m.size() == 16 ? 4 : 3;
  DAffine result(1.0);
  for (size_t row = 0; row < 3; ++row)
    for (size_t column = 0; column < n; ++column) result[int(column)][int(row)] = m[row * n + column];
  if (n == 4 && (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1))
    throw Error(node.where, "the last row of <matrix> must be 0 0 0 1; projective transforms are not possible");
  return result;
}

DAffine parse_look_at(const SceneNode& node) {
  const DVec3 origin = parse_triple(node, node.required("origin"));
  const DVec3 target = parse_triple(node, node.required("target"));
  DVec3 up(0.0);
  if (const std::string* text = node.attribute("up")) up = parse_triple(node, *text);
  const double distance = glm::length(target - origin);
  if (!(distance > 0)) throw Error(node.where, "<lookat> has its target at its origin; move one of them");
  if (up == DVec3(0.0)) up = basis_about((target - origin) / distance)[0];
  const DVec3 left = glm::cross(up / glm::length(up), (target - origin) / distance);
  if (!(glm::length(left) > k_singular))
    throw Error(node.where, "<lookat> looks along its up vector; tilt one of them");
  return look_at(origin, target, up);
}

}  // namespace

DAffine translation(const DVec3& offset) {
  DAffine result(1.0);
  result[3] = offset;
  return result;
}

DAffine scaling(const DVec3& factors) {
  DAffine result(1.0);
  for (int i = 0; i < 3; ++i) result[i][i] = factors[i];
  return result;
}

DAffine rotation(const DVec3& axis, double degrees) {
  const DVec3 a = glm::normalize(axis);
  const double angle = glm::radians(degrees), c = std::cos(angle), s = std::sin(angle);
  DAffine result(1.0);
  for (int i = 0; i < 3; ++i) {
    DVec3 e(0.0);
    e[i] = 1.0;
    result[i] = e * c + glm::cross(a, e) * s + a * (a[i] * (1 - c));  // Rodrigues' formula
  }
  return result;
}

DAffine look_at(const DVec3& origin, const DVec3& target, const DVec3& up) {
  const DVec3 forward = glm::normalize(target - origin);
  const DVec3 left = glm::normalize(glm::cross(up, forward));
  return DAffine(left, glm::cross(forward, left), forward, origin);
}

DAffine parse_transform(const SceneNode& transform, const Diagnostics& diagnostics) {
  DAffine result(1.0);
  for (const SceneNode& node : transform.children) {
    DAffine step(1.0);
    if (node.tag == "translate") {
      step = translation(parse_components(node, 0));
    } else if (node.tag == "scale") {
      step = scaling(parse_components(node, 1));
    } else if (node.tag == "rotate") {
      const DVec3 axis = parse_components(node, 0);
      if (!(glm::length(axis) > 0)) throw Error(node.where, "<rotate> needs an axis; give x, y or z");
      step = rotation(axis, parse_number(node.required("angle"), node.where));
    } else if (node.tag == "matrix") {
      step = parse_matrix(node);
    } else if (node.tag == "lookat") {
      step = parse_look_at(node);
    } else {
      diagnostics.unknown(node.where, "<" + node.tag + "> has no meaning inside <transform>, ignored");
      continue;
    }
    result = compose(step, result);
    for (int i = 0; i < 4; ++i)
      if (!std::isfinite(result[i].x) || !std::isfinite(result[i].y) || !std::isfinite(result[i].z))
        throw Error(node.where, "the transform overflows here; use smaller numbers");
  }
  return result;
}

void require_invertible(const DAffine& transform, const SourceLocation& where) {
  const auto fits = [](const DAffine& t) {
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 3; ++j)
        if (!(std::abs(t[i][j]) <= double(std::numeric_limits<float>::max()))) return false;
    return true;
  };
  if (!fits(transform)) throw Error(where, "the transform is beyond single precision; use smaller numbers");
  DMat3 unit;
  for (int i = 0; i < 3; ++i) {
    const double length = glm::length(transform[i]);
    // A column that vanishes in single precision would flatten the shape.
    if (!(length >= double(std::numeric_limits<float>::min())))
      throw Error(where, "the transform is singular (it scales an axis to nothing); give scale factors other than 0");
    unit[i] = transform[i] / length;
  }
  if (!(std::abs(glm::determinant(unit)) > k_singular))
    throw Error(where, "the transform is singular (it flattens the shape); use a matrix of full rank");
  if (!fits(inverse_affine(transform)))
    throw Error(where, "the transform's inverse is beyond single precision; use larger scale factors");
}

DAffine rigid_part(const DAffine& transform, const std::string& owner, const SourceLocation& where,
                   const Diagnostics& diagnostics) {
  require_invertible(transform, where);
  DAffine t = transform;
  const double scale = glm::length(t[0]);
  for (int i = 0; i < 3; ++i) {
    t[i] /= scale;
    if (std::abs(glm::length(t[i]) - 1) > k_rigid_tolerance)
      throw Error(where, owner + "'s to_world scales its axes unequally; use rotations and translations only");
  }
  for (int i = 0; i < 3; ++i)
    if (std::abs(glm::dot(t[i], t[(i + 1) % 3])) > k_rigid_tolerance)
      throw Error(where, owner + "'s to_world is sheared; use rotations and translations only");
  if (std::abs(scale - 1) > k_rigid_tolerance)
    diagnostics.warning(where, "the scale of " + owner + "'s to_world is left out");
  return t;
}

DAffine without_digits_lost(const DAffine& transform) {
  DAffine t = transform;
  // Entries of a lamp of half size .01 are off by up to 5e-5 of its axes' length, and products of two axes by the root
  // of 3 as much for each of them.
  constexpr double k_most = 2e-4;
  for (int i = 1; i < 3; ++i) {
    for (int j = 0; j < i; ++j) {
      const double product = glm::dot(t[i], t[j]), squared = glm::dot(t[j], t[j]);
      if (std::abs(product) <= k_most * glm::length(t[i]) * std::sqrt(squared)) t[i] -= t[j] * (product / squared);
    }
  }
  for (int i = 1; i < 3; ++i) {
    for (int j = 0; j < i; ++j) {
      const double ratio = glm::length(t[j]) / glm::length(t[i]);
      if (std::abs(ratio - 1.0) > k_most) continue;
      t[i] *= ratio;
      break;
    }
  }
  return t;
}

bool is_mirrored(const DAffine& transform) {
  return glm::determinant(DMat3(transform[0], transform[1], transform[2])) < 0;
}

}  // namespace fieldtrace
