// Camera, film, sampler and integrator of scene files (build_sensor() and build_integrator() of scene_builder.h).

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/loader/scene_builder.h"
#include "core/loader/scene_limits.h"
#include "core/loader/scene_transforms.h"

namespace fieldtrace {
namespace {

// Pixels along an edge. Larger images would overflow no type but are surely a mistake.
constexpr int k_max_film_size = 65536;
constexpr int k_max_samples = 1 << 24;
// Pixels: a filter wider than the widest film blurs every image to one colour.
constexpr Range k_filter_range = {0.0, k_max_film_size, true};
// In film widths. Within this range film positions resolve 2^-16 of the film, a pixel of the widest film.
constexpr Range k_principal_range = {-256.0, 256.0, false};
constexpr Range k_lens_range = {0.0, k_largest_coordinate, false};
// The square of the focus distance must not underflow.
constexpr Range k_focus_range = {1 / k_largest_coordinate, k_largest_coordinate, false};
// Mitsuba's cameras without fov have a 50 mm lens on 36 mm x 24 mm film.
constexpr double k_film_diagonal_mm = 43.266615305567875;
constexpr const char* k_default_lens = "50mm";

Film parse_film(const SceneBuilder& builder, const SceneNode& node) {
  Film film;
  Properties properties = builder.properties(node);
  if (node.type != "hdrfilm")
    builder.diagnostics.unknown(node.where, "unknown film type '" + node.type + "', read as hdrfilm");
  film.width = properties.integer("width", film.width, 1, k_max_film_size);
  film.height = properties.integer("height", film.height, 1, k_max_film_size);
  film.crop.x = properties.integer("crop_offset_x", 0, 0, film.width - 1);
  film.crop.y = properties.integer("crop_offset_y", 0, 0, film.height - 1);
  film.crop.width = properties.integer("crop_width", film.width - film.crop.x, 1, film.width - film.crop.x);
  film.crop.height = properties.integer("crop_height", film.height - film.crop.y, 1, film.height - film.crop.y);
  properties.ignore({"file_format", "pixel_format", "component_format", "banner", "attach_log", "high_quality_edges",
                     "sample_border", "compensate"});
  if (const SceneNode* filter = properties.object("rfilter")) {
    Properties inner = builder.properties(*filter);
    if (filter->type == "box") {
      film.filter = FilterKind::box;
      film.filter_radius = 0.5f;
    } else if (filter->type == "tent") {
      film.filter = FilterKind::tent;
      film.filter_radius = float(inner.number("radius", 1.0, k_filter_range));
    } else if (filter->type == "gaussian") {
      film.gaussian_stddev = float(inner.number("stddev", 0.5, {0.0, k_max_film_size / 4, true}));
      // Mitsuba truncates its gaussian at four standard deviations.
      film.filter_radius = 4 * film.gaussian_stddev;
    } else {
      builder.diagnostics.unknown(filter->where, "unknown filter type '" + filter->type + "', replaced by gaussian");
      inner.ignore({"radius", "stddev", "lobes", "B", "C", "A"});
    }
    inner.finish();
  }
  properties.finish();
  return film;
}

void parse_sampler(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  builder.scene.sample_count = properties.integer("sample_count", 4, 1, k_max_samples);
  builder.scene.seed = uint32_t(properties.integer("seed", 0, 0, std::numeric_limits<int>::max()));
  properties.ignore({"jitter"});
  properties.finish();
}

// Horizontal field of view in degrees from the vertical or diagonal one; aspect = width / height.
double to_horizontal(double degrees, const std::string& axis, double aspect) {
  const double half = std::tan(glm::radians(degrees) / 2);
  if (axis == "y" || (axis == "smaller" && aspect > 1) || (axis == "larger" && aspect <= 1))
    return glm::degrees(2 * std::atan(half * aspect));
  if (axis == "diagonal") return glm::degrees(2 * std::atan(half / std::sqrt(1 + 1 / (aspect * aspect))));
  return degrees;
}

double parse_field_of_view(Properties& properties, double aspect) {
  if (properties.has("fov") && properties.has("focal_length"))
    throw Error(properties.where("fov"), "both fov and focal_length are given; use one of them");
  const std::string axis = properties.choice("fov_axis", "x", {"x", "y", "diagonal", "smaller", "larger"});
  double result;
  if (properties.has("fov")) {
    const Range open = {0.0, std::nextafter(180.0f, 0.0f), true};
    result = to_horizontal(properties.number("fov", 0, open), axis, aspect);
  } else {
    std::string lens = properties.string("focal_length", k_default_lens);
    const SourceLocation where = properties.where("focal_length");
    if (lens.size() > 2 && lens.compare(lens.size() - 2, 2, "mm") == 0) lens.resize(lens.size() - 2);
    const double focal_length = parse_number(lens, where);
    if (!(focal_length > 0)) throw Error(where, "'focal_length' must be positive, such as 50mm");
    result = to_horizontal(glm::degrees(2 * std::atan(k_film_diagonal_mm / (2 * focal_length))), "diagonal", aspect);
  }
  if (!(float(result) > 0 && float(result) < 180))
    throw Error(properties.where("fov"), "the horizontal field of view is not between 0 and 180 degrees");
  return result;
}

void check_focus(const Properties& properties, const Camera& camera) {
  if (camera.focus_distance >= k_focus_range.lower && camera.focus_distance <= k_focus_range.upper) return;
  const char* const given = properties.has("focus_distance") ? "focus_distance" : "far_clip";
  throw Error(properties.where(given),
              fmt::format("the lens is focused at {:.3g}{}, but must be at least {:.3g} and at "
                          "most {:.3g}",
                          camera.focus_distance, properties.has("focus_distance") ? "" : ", its far_clip",
                          k_focus_range.lower, k_focus_range.upper));
}

}  // namespace

void build_sensor(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  const bool thin_lens = node.type == "thinlens";
  if (!thin_lens && node.type != "perspective")
    builder.diagnostics.unknown(node.where, "unknown sensor type '" + node.type + "', read as perspective");

  Film& film = builder.scene.film;
  film.crop = {0, 0, film.width, film.height};
  if (const SceneNode* child = properties.object("film")) film = parse_film(builder, *child);
  builder.scene.sample_count = 4;  // Mitsuba's default, for files without a sampler
  if (const SceneNode* child = properties.object("sampler")) parse_sampler(builder, *child);

  Camera& camera = builder.scene.camera;
  camera.fov_x_degrees = float(parse_field_of_view(properties, double(film.width) / film.height));
  camera.principal_offset.x = float(properties.number("principal_point_offset_x", 0, k_principal_range));
  camera.principal_offset.y = float(properties.number("principal_point_offset_y", 0, k_principal_range));
  camera.near_clip = float(properties.number("near_clip", camera.near_clip, k_positive));
  camera.far_clip = float(properties.number("far_clip", camera.far_clip, k_positive));
  if (!(camera.near_clip < camera.far_clip))
    throw Error(properties.where(properties.has("near_clip") ? "near_clip" : "far_clip"),
                "'near_clip' must be smaller than 'far_clip'");
  camera.focus_distance = float(properties.number("focus_distance", camera.far_clip, k_positive));
  if (thin_lens) {
    if (!properties.has("aperture_radius"))
      throw Error(node.where, "<sensor type=\"thinlens\"> lacks its aperture_radius");
    camera.aperture_radius = float(properties.number("aperture_radius", 0, k_lens_range));
    if (camera.aperture_radius > 0) check_focus(properties, camera);
  }
  check_lens(camera, film, properties.where(camera.aperture_radius > 0 ? "aperture_radius" : "near_clip"));
  builder.placement.camera =
      rigid_part(properties.transform("to_world"), "the camera", properties.where("to_world"), builder.diagnostics);
  builder.places.camera = properties.where("to_world");
  // The scene is static: shutter times have no effect.
  properties.ignore({"shutter_open", "shutter_close"});
  properties.finish();
}

void build_default_sensor(SceneBuilder& builder) {
  Scene& scene = builder.scene;
  scene.film.crop = {0, 0, scene.film.width, scene.film.height};
  scene.sample_count = 4;
  scene.camera.fov_x_degrees = 45.0f;
  if (scene.instances.empty()) return;
  const DBounds bounds = world_bounds(scene, builder.placement);
  // Looks along +z from a distance at which the largest extent fits a field of view of 45 degrees.
  const DVec3 extent = bounds.upper - bounds.lower, centre = bounds.centre();
  const double edge = std::max({extent.x, extent.y, extent.z});
  const double distance = edge / (2 * std::tan(glm::radians(22.5)));
  scene.camera.near_clip = float(distance / 100);
  scene.camera.far_clip = float(edge * 5 + distance);
  scene.camera.focus_distance = float(distance + extent.z / 2);
  builder.placement.camera = translation(DVec3(centre.x, centre.y, bounds.lower.z - distance));
}

void build_integrator(SceneBuilder& builder, const SceneNode& node) {
  Properties properties = builder.properties(node);
  IntegratorSettings& settings = builder.scene.integrator;
  if (node.type == "direct") {
    settings.max_depth = 2;
    // Sample counts are set when rendering.
    properties.ignore({"shading_samples", "emitter_samples", "bsdf_samples"});
  } else {
    if (node.type != "path")
      builder.diagnostics.unknown(node.where, "unknown integrator type '" + node.type + "', read as path");
    settings.max_depth = properties.integer("max_depth", -1, -1, std::numeric_limits<int>::max());
    settings.rr_depth = properties.integer("rr_depth", 5, 1, std::numeric_limits<int>::max());
  }
  settings.hide_emitters = properties.boolean("hide_emitters", false);
  properties.ignore({"timeout", "block_size", "samples_per_pass"});
  properties.finish();
}

}  // namespace fieldtrace
