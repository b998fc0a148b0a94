#include "core/loader/scene_limits.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/loader/scene_recentre.h"
#include "core/math/stretch.h"

namespace fieldtrace {
namespace {

// Bound on unnormalised directions of lens rays, whose squares must stay finite.
constexpr double k_largest_direction = 0x1p62;

SourceLocation place_of(const std::vector<SourceLocation>& places, size_t i) {
  return i < places.size() ? places[i] : SourceLocation();
}

struct WorldBox {
  DVec3 lower = DVec3(std::numeric_limits<double>::infinity());
  DVec3 upper = DVec3(-std::numeric_limits<double>::infinity());

  // Adds the ball of radius `reach` about p, which bounds `what`.
  void extend(const DVec3& p, double reach, const char* what, const SourceLocation& where) {
    const DVec3 far = glm::abs(p) + reach;
    const double most = std::max({far.x, far.y, far.z});
    // Negated so that NaN is refused too.
    if (!(far.x <= k_largest_coordinate && far.y <= k_largest_coordinate && far.z <= k_largest_coordinate)) {
      throw Error(where, fmt::format("{} reaches to the coordinate {:.3g}; at most {:.3g} is possible, so bring it "
                                     "nearer or use larger units",
                                     what, most, k_largest_coordinate));
    }
    lower = glm::min(lower, p - reach);
    upper = glm::max(upper, p + reach);
  }
  double diameter() const { return lower.x <= upper.x ? glm::length(upper - lower) : 0.0; }
};

WorldBox world_box(const Scene& scene, const ScenePlaces& places) {
  WorldBox box;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const DAffine t(instance.to_world);
    for (int c = 0; c < 8; ++c) {
      const DVec3 corner(scene.shapes[instance.shape].bounds.corner(c));
      box.extend(transform_point(t, corner), 0, "the shape", place_of(places.instances, i));
    }
  }
  for (size_t i = 0; i < scene.emitters.size(); ++i) {
    if (scene.emitters[i].kind != EmitterKind::point) continue;
    box.extend(DVec3(scene.emitters[i].position), 0, "the light", place_of(places.emitters, i));
  }
  box.extend(DVec3(scene.camera.to_world[3]), camera_reach(scene.camera, scene.film), "the camera", places.camera);
  return box;
}

// The determinant's magnitude as a share of the sum of its terms' magnitudes: 1 where nothing cancels.
double determinant_share(const DMat3& m) {
  double terms = 0;
  for (int i = 0; i < 3; ++i) {
    const DVec3 &a = m[i], &b = m[(i + 1) % 3], &c = m[(i + 2) % 3];
    terms += std::abs(a.x * b.y * c.z) + std::abs(a.x * b.z * c.y);
  }
  return std::abs(glm::determinant(m)) / terms;
}

// The largest entry of |m| |m^-1|, by which a rounding error grows on the way to object space and back (R. D. Skeel,
// "Scaling for numerical stability in Gaussian elimination", JACM 26(3), 1979).
double condition(const DMat3& m) {
  const DMat3 inverse = glm::inverse(m);
  double largest = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double sum = 0;
      for (int k = 0; k < 3; ++k) sum += std::abs(m[k][i] * inverse[j][k]);
      largest = std::max(largest, sum);
    }
  }
  return largest;
}

double smallest_stretch(const DMat3& m) { return 1 / largest_stretch(glm::inverse(m)); }

// Checks one instance of a scene of the given diameter.
void check_instance(const Scene& scene, const Instance& instance, double diameter, const SourceLocation& where) {
  const DAffine t(instance.to_world);
  const DMat3 linear(t[0], t[1], t[2]);
  const double remaining = determinant_share(linear);
  if (!(remaining >= k_least_determinant)) {
    throw Error(where,
                fmt::format("the transform all but flattens the shape: its determinant is {:.2g} of what it would "
                            "be without cancellation, less than {:.2g}, which single precision needs to undo it; "
                            "scale less unequally, or transform the mesh's vertices beforehand",
                            remaining, k_least_determinant));
  }
  const double growth = condition(linear);
  if (!(growth <= k_largest_condition)) {
    throw Error(where,
                fmt::format("the transform all but flattens the shape: rounding errors grow by {:.2g} on the way "
                            "to the shape's own axes and back, more than {:.2g}; scale before rotating, scale "
                            "less unequally, or transform the mesh's vertices beforehand",
                            growth, k_largest_condition));
  }
  const double largest = largest_stretch(linear), smallest = smallest_stretch(linear);
  if (!(smallest >= k_smallest_scale && largest <= k_largest_scale)) {
    throw Error(where,
                fmt::format("the transform scales by {:.3g}; factors between {:.3g} and {:.3g} are possible, so "
                            "use other units",
                            smallest >= k_smallest_scale ? largest : smallest, k_smallest_scale, k_largest_scale));
  }
  const Bounds3& bounds = scene.shapes[instance.shape].bounds;
  const double size = glm::length(DVec3(bounds.upper) - DVec3(bounds.lower));
  if (!(size >= k_smallest_shape)) {
    throw Error(where, fmt::format("the shape has a size of {:.3g} before its transform; at least {:.3g} is possible, "
                                   "so enlarge its vertices and shrink it by to_world",
                                   size, k_smallest_shape));
  }
  const double across = diameter / smallest;
  if (!(across <= k_largest_ray && across * across * size <= k_largest_product)) {
    throw Error(where, fmt::format("the scene is {:.3g} across in this shape's own units, of which the shape measures "
                                   "{:.3g}; single precision cannot hold both, so enlarge the shape or bring the scene "
                                   "together",
                                   across, size));
  }
}

double distance_to_box(const DVec3& lower, const DVec3& upper, const DVec3& p) {
  return glm::length(glm::max(glm::max(lower - p, p - upper), DVec3(0.0)));
}

struct WorldTriangle {
  DVec3 a, b, c;
  double longest_edge() const { return std::max({glm::length(b - a), glm::length(c - b), glm::length(a - c)}); }
  // A lower bound on the distance from p: to the triangle's plane or to its box.
  double distance(const DVec3& p) const {
    const DVec3 normal = glm::cross(b - a, c - a);
    const double length = glm::length(normal);
    const DVec3 lower = glm::min(a, glm::min(b, c)), upper = glm::max(a, glm::max(b, c));
    const double to_plane = length > 0 ? std::abs(glm::dot(p - a, normal)) / length : 0.0;
    return std::max(to_plane, distance_to_box(lower, upper, p));
  }
};

WorldTriangle triangle_of(const TriangleMesh& mesh, const UVec3& index, const DAffine& t) {
  const auto corner = [&](uint32_t i) { return transform_point(t, DVec3(mesh.positions[i])); };
  return {corner(index.x), corner(index.y), corner(index.z)};
}

// From p to the world's box about a transformed box.
double distance_to_box(const Bounds3& bounds, const DAffine& t, const DVec3& p) {
  DBounds world;
  world.extend(t, bounds);
  return distance_to_box(world.lower, world.upper, p);
}

double longest_edge(const TriangleMesh& mesh) {
  double longest = 0;
  for (const UVec3& index : mesh.triangles)
    longest = std::max(longest, triangle_of(mesh, index, DAffine(1.0)).longest_edge());
  return longest;
}

// Upper bound on the tangent of the angle between the camera's axis and its rays.
double steepest(const Camera& camera, const Film& film) {
  const double tangent = std::tan(0.5 * glm::radians(double(camera.fov_x_degrees)));
  const auto side = [&](float offset, int pixels) {
    return 1 + 2 * (std::abs(double(offset)) + double(film.filter_radius) / pixels);
  };
  const double x = tangent * side(camera.principal_offset.x, film.width);
  const double y = tangent * film.height / film.width * side(camera.principal_offset.y, film.height);
  return std::hypot(x, y);
}

}  // namespace

RayLimits ray_limits(const Scene& scene) {
  RayLimits limits = {k_largest_coordinate, k_largest_ray, 0.0};
  for (const Instance& instance : scene.instances) {
    const DAffine t(instance.to_world);
    // Of vectors whose coordinates are no larger, with room for a sum of two.
    const double reach = k_largest_ray * smallest_stretch(DMat3(t[0], t[1], t[2])) / 4;
    limits.largest_coordinate = std::min(limits.largest_coordinate, reach - glm::length(t[3]));
    limits.longest_direction = std::min(limits.longest_direction, reach);
  }
  // Products with two edges that a millionth of the scene measures do not underflow.
  limits.shortest_direction = world_box(scene, {}).diameter() * 0x1p-20;
  return limits;
}

double camera_reach(const Camera& camera, const Film& film) {
  const double aperture = camera.aperture_radius;
  const double slope = steepest(camera, film) + (aperture > 0 ? aperture / double(camera.focus_distance) : 0.0);
  return double(camera.near_clip) * std::hypot(1.0, slope) + aperture;
}

void check_lens(const Camera& camera, const Film& film, const SourceLocation& where) {
  const double reach = camera_reach(camera, film);
  if (!(reach <= k_largest_coordinate)) {
    throw Error(where,
                fmt::format("the camera's rays start as far as {:.3g} from it, at most {:.3g} is possible; use a "
                            "smaller near_clip, aperture_radius or fov, or a larger focus_distance",
                            reach, k_largest_coordinate));
  }
  if (camera.aperture_radius > 0 && !(steepest(camera, film) * double(camera.focus_distance) <= k_largest_direction)) {
    throw Error(where, "the lens sees too wide an angle for its focus_distance; make one of them smaller");
  }
}

void check_scene_limits(const Scene& scene, const ScenePlaces& places) {
  const double diameter = world_box(scene, places).diameter();
  for (size_t i = 0; i < scene.instances.size(); ++i)
    check_instance(scene, scene.instances[i], diameter, place_of(places.instances, i));
  if (!scene.instances.empty() && !(diameter >= k_smallest_scene)) {
    throw Error(places.scene, fmt::format("the whole scene is only {:.3g} across; at least {:.3g} is possible, so use "
                                          "smaller units",
                                          diameter, k_smallest_scene));
  }
}

void warn_of_blurred_triangles(const Scene& scene, const ScenePlaces& places, const Diagnostics& diagnostics) {
  const DVec3 camera(scene.camera.to_world[3]);
  const double nearest = scene.camera.near_clip;  // surfaces in front of it are clipped
  std::vector<double> longest(scene.shapes.size(), 0.0);
  for (size_t s = 0; s < scene.shapes.size(); ++s) longest[s] = longest_edge(scene.shapes[s].mesh);
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const DAffine t(instance.to_world);
    const double stretch = largest_stretch(DMat3(t[0], t[1], t[2]));
    const Shape& shape = scene.shapes[instance.shape];
    const double reach = std::max(distance_to_box(shape.bounds, t, camera), nearest);
    if (longest[instance.shape] * stretch <= k_blurred_triangle * reach) continue;
    const TriangleMesh& mesh = shape.mesh;
    for (const UVec3& index : mesh.triangles) {
      const WorldTriangle triangle = triangle_of(mesh, index, t);
      const double edge = triangle.longest_edge(), distance = std::max(triangle.distance(camera), nearest);
      if (edge <= k_blurred_triangle * distance) continue;
      diagnostics.unknown(
          place_of(places.instances, i),
          fmt::format(
              "a triangle of this shape is {:.3g} across and passes within {:.3g} of the camera, too large for "
              "single precision: shadows and textures on it are blurred by {:.2g}; make it smaller or cut it up",
              edge, distance, edge * 0x1p-24));
      break;
    }
  }
}

}  // namespace fieldtrace
