#include "hybrid/sky/indirect_light.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/platform/parallel.h"
#include "core/simd/vec_lanes.h"
#include "field/bake/cell_lines.h"
#include "field/maps/cell_radiance.hd.h"
#include "hybrid/sky/affine_rows.h"
#include "hybrid/sky/plane_windows.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

// How far beyond a plane, in units of its radius, something must reach to be on that side.
constexpr float k_beside = 1e-4f;

// Surfels of an object, roughly.
constexpr uint64_t k_usual_surfels = 1500;

// Of an object: what is seen first and last along each direction.
constexpr int k_object_pyramids = 2 * k_object_directions * k_object_directions;

// Corners of what bounds an occluder.
std::vector<Vec3> corners_of(const Scene& scene, const SkyOccluder& o) {
  if (o.kind == SkyOccluder::Kind::plane) {
    const PlaneCorners corners = plane_corners(o);
    return {corners.begin(), corners.end()};
  }
  const Instance& instance = scene.instances[o.instance];
  const Bounds3& bounds = scene.shapes[instance.shape].bounds;
  std::vector<Vec3> corners;
  for (int k = 0; k < 8; ++k) corners.push_back(transform_point(instance.to_world, bounds.corner(k)));
  return corners;
}

// Which sides of a plane others may see.
void seen_sides(const Scene& scene, std::span<const SkyOccluder> all, const SkyOccluder& plane, bool sides[2]) {
  sides[0] = sides[1] = false;
  for (const SkyOccluder& other : all) {
    if (&other == &plane) continue;
    for (const Vec3& corner : corners_of(scene, other)) {
      const float height = transform_by(plane.to_unit, corner).z;
      if (std::abs(height) > k_beside * plane.ball.radius) sides[height < 0.0f] = true;
    }
  }
}

// x, y: gradients of the plane's coordinates.
RadianceWindow radiance_window(const PlaneWindow& w, const Vec3& x, const Vec3& y, int texels) {
  RadianceWindow window;
  const Vec2 middle = 0.5f * (w.lower + w.upper), size = w.upper - w.lower;
  window.x = middle.x, window.y = middle.y;
  window.per_unit_x = float(texels) / size.x, window.per_unit_y = float(texels) / size.y;
  // Squares of areas overflow floats in scenes of small units.
  const double area = glm::length(glm::cross(DVec3(x), DVec3(y)));
  window.density = float(std::sqrt(double(window.per_unit_x) * double(window.per_unit_y) * area));
  return window;
}

}  // namespace

IndirectLight::Cost IndirectLight::cost(size_t planes, size_t objects, int plane_texels) {
  constexpr int k_plane_pyramids = 4;  // two windows, two sides
  const uint64_t plane_surfels = uint64_t(k_plane_pyramids) * uint64_t(plane_texels * plane_texels);
  return {planes * RadiancePyramids::bytes_of(plane_texels, k_plane_pyramids) +
              objects * RadiancePyramids::bytes_of(k_object_texels, k_object_pyramids),
          planes * plane_surfels / 2 + objects * k_usual_surfels};
}

IndirectLight::IndirectLight(const Scene& scene, const Accel& accel, const SkyMaps& maps,
                             std::span<const ShapeTraits> traits, std::span<const uint8_t> sends,
                             std::span<const Vec3> seen, int plane_texels)
    : maps_(maps), plane_texels_(plane_texels), instances_(maps.occluders().size()) {
  for (int i = 0; i < k_object_directions * k_object_directions; ++i) {
    const CellFrame f = cell_frame(i / k_object_directions, i % k_object_directions, k_object_directions);
    frames_.emplace_back(f.s, f.t, f.c);
  }
  const MappedShapes& mapped = maps.shapes();
  const PlaneShapes planes = plane_shapes(scene, traits);
  const auto has_maps = [&](const SkyOccluder& o) {
    return sends[o.instance] && o.kind != SkyOccluder::Kind::plane && o.kind != SkyOccluder::Kind::box;
  };
  std::vector<uint8_t> is_wanted(mapped.shapes.size());
  for (const SkyOccluder& o : maps.occluders()) {
    if (has_maps(o)) is_wanted[mapped.of_instance[o.instance]] = 1;
  }
  std::vector<std::shared_ptr<const Surfels>> of_mapped(mapped.shapes.size());
  // Isolated: else a thread that waits for a shape's lines would begin another's.
  parallel_for_isolated(of_mapped.size(), [&](size_t k) {
    if (!is_wanted[k]) return;
    of_mapped[k] =
        std::make_shared<const Surfels>(make_surfels(accel, mapped.shapes[k], k_object_directions, k_object_texels));
  });
  parallel_for(maps.occluders().size(), [&](size_t i) {
    const SkyOccluder& o = maps.occluders()[i];
    const uint32_t shape = scene.instances[o.instance].shape;
    OfInstance& own = instances_[o.instance];
    if (!sends[o.instance]) {
      own.surfels = std::make_shared<const Surfels>();
    } else if (o.kind == SkyOccluder::Kind::plane) {
      add_plane(scene, accel, *planes.parallelograms[shape], seen, o);
    } else if (o.kind == SkyOccluder::Kind::box) {
      add_box(accel, shape, *planes.boxes[shape], o);
    } else {
      own.surfels = of_mapped[mapped.of_instance[o.instance]];
      if (own.surfels->points.empty()) return;
      own.pyramids = std::make_unique<RadiancePyramids>(k_object_texels, k_object_pyramids);
      own.view = own.pyramids->view();
    }
  });
  for (const SkyOccluder& o : maps.occluders()) {
    const bool is_left = !sends[o.instance] || (has_maps(o) && instances_[o.instance].surfels->points.empty());
    if (is_left) others_.push_back(o.ball);
  }
}

void IndirectLight::add_box(const Accel& accel, uint32_t shape, const BoxFaces& faces, const SkyOccluder& o) {
  OfInstance& own = instances_[o.instance];
  const int texels = plane_texels_ / 2;
  Surfels all;
  const PlaneWindow whole[1];
  const bool outside[2] = {true, false};
  for (const Parallelogram& face : faces) {
    const Surfels s = make_plane_surfels(accel, shape, face, Vec3(face.axes[2]), whole, texels, outside);
    const auto first = uint32_t(all.points.size());
    for (const uint32_t point : s.texels) all.texels.push_back(point == k_none ? k_none : first + point);
    for (const uint32_t point : s.representative) all.representative.push_back(first + point);
    all.points.insert(all.points.end(), s.points.begin(), s.points.end());
    all.reflectance_spots.insert(all.reflectance_spots.end(), s.reflectance_spots.begin(), s.reflectance_spots.end());
  }
  own.surfels = std::make_shared<const Surfels>(std::move(all));
  own.pyramids = std::make_unique<RadiancePyramids>(texels, int(2 * faces.size()));
  own.view = own.pyramids->view();
  for (int face = 0; face < int(faces.size()); ++face) {
    const Vec3 normal = row_of(o.to_unit, face / 2);
    const Vec3 x = gradient_within(row_of(o.to_unit, (face / 2 + 1) % 3), normal);
    const Vec3 y = gradient_within(row_of(o.to_unit, (face / 2 + 2) % 3), normal);
    PlaneRadiance& plane = own.planes.emplace_back();
    plane.view = &own.view;
    plane.begin = 2 * face * own.view.bytes;
    plane.windows = 1;
    plane.window[0] = radiance_window(whole[0], x, y, texels);
  }
}

void IndirectLight::add_plane(const Scene& scene, const Accel& accel, const Parallelogram& plane,
                              std::span<const Vec3> seen, const SkyOccluder& o) {
  OfInstance& own = instances_[o.instance];
  const Instance& instance = scene.instances[o.instance];
  bool sides[2];
  seen_sides(scene, maps_.occluders(), o, sides);
  // Walls end floors where the finest texels would tell.
  const std::vector<PlaneWindow> windows = plane_windows(maps_.occluders(), o, seen, k_most_plane_texels);
  const DAffine to_world(instance.to_world);
  // The side that heights are positive on: mirrored transforms exchange the sides.
  const bool mirrored = glm::determinant(DMat3(to_world[0], to_world[1], to_world[2])) < 0.0;
  const Vec3 normal(mirrored ? -plane.axes[2] : plane.axes[2]);
  own.surfels = std::make_shared<const Surfels>(
      make_plane_surfels(accel, instance.shape, plane, normal, windows, plane_texels_, sides));
  own.pyramids = std::make_unique<RadiancePyramids>(plane_texels_, int(2 * windows.size()));
  own.view = own.pyramids->view();
  PlaneRadiance& radiance = own.planes.emplace_back();
  radiance.view = &own.view;
  for (const PlaneWindow& w : windows) {
    radiance.window[radiance.windows++] = radiance_window(w, row_of(o.to_unit, 0), row_of(o.to_unit, 1), plane_texels_);
  }
}

bool IndirectLight::may_meet_others(const Vec3& origin, const Vec3& d) const {
  for (const Sphere& ball : others_) {
    const Vec3 to = ball.centre - origin;
    const float along = glm::dot(to, d), squared = glm::dot(to, to), reach = ball.radius * ball.radius;
    if (squared <= reach || (along > 0.0f && squared - along * along <= reach)) return true;
  }
  return false;
}

void IndirectLight::set_radiance(size_t instance, std::span<const Rgb> radiance) {
  OfInstance& own = instances_[instance];
  if (!own.pyramids) return;
  float most = 0.0f;
  own.luminance_sum = 0.0;
  for (const Rgb& r : radiance) {
    most = std::max({most, r.x, r.y, r.z});
    own.luminance_sum += double(luminance(r));
  }
  own.pyramids->set_most(most);
  const size_t texels = size_t(own.view.texels) * size_t(own.view.texels);
  const std::vector<uint32_t>& seen = own.surfels->texels;
  std::vector<Rgb> values(texels);
  std::vector<uint8_t> is_known(texels);
  for (size_t i = 0; i < seen.size() / texels; ++i) {
    for (size_t t = 0; t < texels; ++t) {
      const uint32_t point = seen[i * texels + t];
      is_known[t] = point != k_none;
      values[t] = is_known[t] ? radiance[point] : Rgb(0.0f);
    }
    own.pyramids->fill(int(i), values, is_known);
  }
  own.view = own.pyramids->view();
}

void IndirectLight::finish() {
  double sum = 0.0;
  size_t count = 0;
  for (const OfInstance& own : instances_) sum += own.luminance_sum, count += own.surfels->points.size();
  mean_luminance_ = count ? float(sum / double(count)) : 0.0f;
}

MapRadiance IndirectLight::lines_of(const SkyOccluder& o, int map) const {
  const Mat3& frame = frames_[size_t(map)];
  const OfInstance& own = instances_[o.instance];
  const float half_texels = 0.5f * float(k_object_texels);
  MapRadiance lines;
  write_row(o.to_unit, frame[0], half_texels, half_texels, lines.u);
  write_row(o.to_unit, frame[1], half_texels, half_texels, lines.v);
  lines.outer = 2 * map * own.view.bytes, lines.inner = lines.outer + own.view.bytes;
  lines.view = own.pyramids ? &own.view : nullptr;
  return lines;
}

MapRadiance IndirectLight::map_radiance(const SkyOccluder& o, const Vec3& d, float cell_width) const {
  const Vec3 unit = glm::normalize(rotate_by(o.to_unit, d));
  const int map = direction_cell(unit, k_object_directions);
  const Mat3& frame = frames_[size_t(map)];
  const float half_texels = 0.5f * float(k_object_texels), along = glm::dot(frame[2], unit);
  MapRadiance lines = lines_of(o, map);
  lines.slope_u = half_texels * glm::dot(frame[0], unit) / along;
  lines.slope_v = half_texels * glm::dot(frame[1], unit) / along;
  lines.reach = cell_width * half_texels / along;
  lines.place = glm::dot(o.ball.centre, d);
  return lines;
}

Rgb IndirectLight::radiance(uint32_t instance, const Vec3& position, const Vec3& origin, const Vec3& d) const {
  const SkyOccluder& o = maps_.occluders()[instance];
  const OfInstance& own = instances_[instance];
  if (!own.pyramids) return Rgb(0.0f);
  if (o.kind == SkyOccluder::Kind::plane) {
    const Vec3 at = transform_by(o.to_unit, position), from = transform_by(o.to_unit, origin);
    const PlaneRadiance& plane = own.planes[0];
    return to_vec(
        scalar::read_plane<float>(plane, scalar::side_of_plane<float>(plane, from.z), at.x, at.y, 0.0f, true));
  }
  if (o.kind == SkyOccluder::Kind::box) {
    const Vec3 at = transform_by(o.to_unit, position);
    const int face = box_face_at(at);
    const PlaneRadiance& plane = own.planes[size_t(face)];
    return to_vec(
        scalar::read_plane<float>(plane, plane.begin, at[(face / 2 + 1) % 3], at[(face / 2 + 2) % 3], 0.0f, true));
  }
  const Vec3 unit = glm::normalize(rotate_by(o.to_unit, d));
  const int map = direction_cell(unit, k_object_directions);
  const bool outside = glm::dot(unit, transform_by(o.to_unit, origin)) < -1.0f;
  const MapRadiance lines = lines_of(o, map);
  const auto p = lanes(position);
  return to_vec(scalar::read_radiance<float>(own.view, outside ? lines.outer : lines.inner,
                                             scalar::affine<float>(lines.u, p), scalar::affine<float>(lines.v, p), 0.0f,
                                             true));
}

uint64_t IndirectLight::bytes() const {
  uint64_t bytes = 0;
  for (const OfInstance& own : instances_) bytes += own.pyramids ? own.pyramids->bytes() : 0;
  return bytes;
}

}  // namespace fieldtrace
