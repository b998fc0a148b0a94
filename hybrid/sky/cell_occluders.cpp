#include "hybrid/sky/cell_occluders.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "field/bake/cell_lines.h"
#include "hybrid/sky/affine_rows.h"

namespace fieldtrace {
namespace {

// A bilinear read covers so many texels about its place.
constexpr float k_read_reach = 1.5f;
// What a cell whose light varies counts as clear on its own object, of what others do: it may be bright.
constexpr float k_divided_clear = 0.4f;

// `unit`: the cell's direction in unit space; `width`: its extent, radians; `distance`: Sky::distance().
MapLines map_lines(const SkyOccluder& o, const SkyMaps& sky, int map, const Vec3& unit, float width, float distance) {
  const Mat3& frame = sky.frame(map);  // s, t, c
  const float half_texels = 0.5f * float(o.view.texels), along = glm::dot(frame[2], unit);
  MapLines lines;
  write_row(o.to_unit, frame[0], half_texels, half_texels, lines.u);
  write_row(o.to_unit, frame[1], half_texels, half_texels, lines.v);
  write_row(o.to_unit, frame[2], 1.0f, 0.0f, lines.z);
  lines.slope_u = half_texels * glm::dot(frame[0], unit) / along;
  lines.slope_v = half_texels * glm::dot(frame[1], unit) / along;
  lines.reach = k_footprint * width * half_texels / along;
  lines.per_z = o.half_map / along;
  lines.margin = sky.tolerance().margin / half_texels;
  lines.depth_begin = map * o.view.depth_bytes;
  lines.coverage_begin = map * o.view.coverage_bytes;
  lines.maps = &o.view;
  if (distance < k_infinity) {
    lines.within = along * distance / o.half_map;
    lines.back_begin = opposite_cell(map, sky.directions()) * o.view.depth_bytes;
  }
  return lines;
}

// Of the plane on which the coordinate `z_row` of an occluder's is `at`; heights are positive on the side of larger
// ones, or, if `side` is -1, of smaller ones. `d`: of the cell.
PlaneLines plane_lines(const SkyOccluder& o, int x_row, int y_row, int z_row, float side, float at, const Vec3& d) {
  const Vec3 unit[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, z = row_of(o.to_unit, z_row);
  const float per_unit = side / glm::length(z);
  PlaneLines lines;
  write_row(o.to_unit, unit[z_row], per_unit, -per_unit * at, lines.height);
  // Coordinates are those at the foot on the plane: a shear gives them gradients along its normal.
  const auto write = [&](int row, float out[4]) {
    write_row(o.to_unit, unit[row], 1.0f, 0.0f, out);
    const float along = glm::dot(row_of(o.to_unit, row), Vec3(lines.height[0], lines.height[1], lines.height[2]));
    for (int c = 0; c < 4; ++c) out[c] -= along * lines.height[c];
    return Vec3(out[0], out[1], out[2]);
  };
  const Vec3 x = write(x_row, lines.x), y = write(y_row, lines.y);
  lines.centre = {glm::dot(x, d), glm::dot(y, d), per_unit * glm::dot(z, d)};
  lines.per_unit_x = glm::dot(x, x), lines.per_unit_y = glm::dot(y, y), lines.x_dot_y = glm::dot(x, y);
  return lines;
}

PlaneLines plane_lines(const SkyOccluder& o, const Vec3& d) { return plane_lines(o, 0, 1, 2, 1.0f, 0.0f, d); }

// Of face 2 a + s of a box, which is seen from outside.
PlaneLines face_lines(const SkyOccluder& o, int face, const Vec3& d) {
  const int axis = face / 2;
  const float side = face % 2 == 0 ? 1.0f : -1.0f;
  PlaneLines lines = plane_lines(o, (axis + 1) % 3, (axis + 2) % 3, axis, side, side, d);
  lines.one_sided = true;
  return lines;
}

float height_of(const PlaneLines& plane, const Vec3& p) {
  const float* const h = plane.height;
  return h[0] * p.x + h[1] * p.y + h[2] * p.z + h[3];
}

// By how much the heights of a ball's points and its radius are rounded, at most.
float height_error(const PlaneLines& plane, const Sphere& ball) {
  const float* const h = plane.height;
  const Vec3 c = glm::abs(ball.centre);
  const float largest = std::abs(h[0]) * c.x + std::abs(h[1]) * c.y + std::abs(h[2]) * c.z + std::abs(h[3]);
  return gamma_bound(16) * (largest + ball.radius);
}

// Whether the ball lies on one side of the plane, `height` (height_of()) from its centre.
bool is_apart(const PlaneLines& plane, float height, const Sphere& ball) {
  return std::abs(height) > ball.radius + height_error(plane, ball);
}

// Whether a flat object that point i is on lies in the plane of a flat occluder, which then hides nothing from it.
// object: encloses the former.
bool holds(const SkyOccluder& occluder, const Sphere& object, const ShadingPointBatch& points, size_t i) {
  PlaneLines plane = {};
  std::copy_n(occluder.height, 4, plane.height);
  const Vec3 normal(plane.height[0], plane.height[1], plane.height[2]);
  const float rise = glm::length(glm::cross(normal, points.geometric_normal(i))) * object.radius;
  return std::abs(height_of(plane, points.position(i))) + rise <= height_error(plane, object) + points.error[i];
}

// Whether some of the points on a box are on the inner side of its faces.
bool faces_inwards(const SkyOccluder& box, const ShadingPointBatch& points) {
  for (size_t i = 0; i < points.size; ++i) {
    const int face = box_face_at(transform_by(box.to_unit, points.position(i)));
    const float outwards = glm::dot(row_of(box.to_unit, face / 2), points.geometric_normal(i));
    if ((face % 2 == 0 ? outwards : -outwards) < 0.0f) return true;
  }
  return false;
}

// Whether the cell leaves the plane on the side on which all points of the ball are, so that none sees it there.
bool turns_away(const PlaneLines& plane, const Sphere& from, float half) {
  const float height = height_of(plane, from.centre);
  return is_apart(plane, height, from) && (height > 0.0f ? plane.centre.rise : -plane.centre.rise) > half;
}

// Whether the plane hides all of the cell from all points of the ball: share_of_slope()
// (field/maps/cell_visibility.hd.h) would find it inside all edges from the ball's worst point.
bool hides(const PlaneLines& plane, const Sphere& from, float half) {
  constexpr float k_rounding = 1e-3f;
  half *= 1.0f + k_rounding;
  const float height = height_of(plane, from.centre), high = std::abs(height) + from.radius;
  const float fall = height > 0.0f ? -plane.centre.rise : plane.centre.rise;
  if (!is_apart(plane, height, from) || fall < half) return false;
  const auto within = [&](const float* row, float change, float per_unit) {
    const float at = row[0] * from.centre.x + row[1] * from.centre.y + row[2] * from.centre.z + row[3];
    const float per_length = std::sqrt(per_unit), edge = 1.0f - std::abs(at) - from.radius * per_length;
    return fall * edge - half * std::abs(edge) >= high * (std::abs(change) + half * per_length);
  };
  return within(plane.x, plane.centre.dx, plane.per_unit_x) && within(plane.y, plane.centre.dy, plane.per_unit_y);
}

}  // namespace

bool meets_cone(const Sphere& ball, const Sphere& from, const Vec3& axis, float angle) {
  const Vec3 to = ball.centre - from.centre;
  const float distance = glm::length(to), reach = ball.radius + from.radius;
  if (distance <= reach) return true;
  constexpr float k_rounding = 1e-4f;
  const float widest = std::asin(reach / distance) + angle + k_rounding;
  return widest >= k_pi || glm::dot(to, axis) >= std::cos(widest) * distance;
}

Sphere ball_about(const ShadingPointBatch& points) {
  Bounds3 bounds;
  for (size_t i = 0; i < points.size; ++i) bounds.extend(points.position(i));
  return {bounds.centre(), 0.5f * glm::length(bounds.diagonal())};
}

CellPoints cell_points(const ShadingPointBatch& p, float grazing) {
  return {p.px.data(), p.py.data(), p.pz.data(), p.gx.data(), p.gy.data(),
          p.gz.data(), p.sx.data(), p.sy.data(), p.sz.data(), int32_t(padded(p.size)),
          grazing};
}

void CellOccluders::bound(const ShadingPointBatch& points) {
  Vec3 sum(0.0f);
  const auto normal = [&](size_t i) { return points.shading_normal(i); };
  for (size_t i = 0; i < points.size; ++i) sum += normal(i);
  ball_ = ball_about(points);
  mean_normal_ = glm::length(sum) > 0.0f ? glm::normalize(sum) : Vec3(0.0f, 0.0f, 1.0f);
  float least = 1.0f;
  for (size_t i = 0; i < points.size; ++i) least = std::min(least, glm::dot(mean_normal_, normal(i)));
  constexpr float k_rounding = 1e-4f;
  normal_cosine_ = std::max(least - k_rounding, -1.0f);
  normal_sine_ = std::sqrt(1.0f - normal_cosine_ * normal_cosine_);
}

void CellOccluders::find_lit() {
  const float half = std::min(sky_->cell_width(), 0.5f * k_pi);
  const float sine = normal_sine_ * std::cos(half) + normal_cosine_ * std::sin(half);
  const bool all = normal_cosine_ < std::sin(half);
  lit_.clear();
  const Vec3 n = glm::transpose(grid_) * mean_normal_;
  const size_t count = light_->cells.size();
  for (size_t cell = 0; cell < count; ++cell) {
    if (all || glm::dot(light_->directions[cell], n) > -sine) lit_.push_back(uint32_t(cell));
  }
  for (auto* v : {&lit_x_, &lit_y_, &lit_z_}) v->resize(lit_.size());
  for (size_t k = 0; k < lit_.size(); ++k) {
    const Vec3& d = light_->directions[lit_[k]];
    lit_x_[k] = d.x, lit_y_[k] = d.y, lit_z_[k] = d.z;
  }
  faces_.resize(lit_.size());
  maps_.resize(count), radiance_.resize(count), planes_.resize(count), balls_.resize(count);
  for (size_t k = 0; k < lit_.size(); ++k) {
    maps_[k].clear(), radiance_[k].clear(), planes_[k].clear(), balls_[k].clear();
  }
}

// Whether something of it may lie within the distance of a point.
bool CellOccluders::is_reached(const SkyOccluder& o) const {
  if (distance_ == k_infinity) return true;
  constexpr float k_rounding = 1e-4f;
  const float reach = (distance_ + ball_.radius) * (1.0f + k_rounding);
  if (glm::length(o.ball.centre - ball_.centre) - o.ball.radius > reach) return false;
  return o.kind != SkyOccluder::Kind::plane || std::abs(height_of(plane_lines(o, Vec3(0.0f)), ball_.centre)) <= reach;
}

// In passes that compilers vectorise: few cells face an object. `to` is a copy, since the bytes written may lie
// anywhere.
void CellOccluders::find_facing(Vec3 to, float least) {
  const float *x = lit_x_.data(), *y = lit_y_.data(), *z = lit_z_.data();
  uint8_t* const faces = faces_.data();
  for (size_t k = 0; k < lit_.size(); ++k) faces[k] = x[k] * to.x + y[k] * to.y + z[k] * to.z >= least;
}

template <class F>
void CellOccluders::for_facing(const F& each) const {
  const size_t count = lit_.size();
  const uint8_t* const faces = faces_.data();
  for (size_t k = 0; k < count; ++k) {
    if (k % 8 == 0 && k + 8 <= count) {
      uint64_t eight;
      std::memcpy(&eight, faces + k, 8);
      if (eight == 0) {
        k += 7;
        continue;
      }
    }
    if (faces[k]) each(k);
  }
}

// Finds the faces of a box that may hide something from the points; false if some of these lie within it.
bool CellOccluders::find_seen_faces(const SkyOccluder& box, const ShadingPointBatch& points) {
  seen_faces_.clear();
  for (int face = 0; face < 6; ++face) {
    PlaneLines plane = face_lines(box, face, Vec3(0.0f));
    plane.least_height = -height_error(plane, ball_);
    if (height_of(plane, ball_.centre) >= plane.least_height - ball_.radius) seen_faces_.push_back({face, plane});
  }
  for (size_t i = 0; i < points.size; ++i) {
    const bool is_outside = std::any_of(seen_faces_.begin(), seen_faces_.end(), [&](const SeenFace& f) {
      return height_of(f.plane, points.position(i)) >= f.plane.least_height;
    });
    if (!is_outside) return false;
  }
  return true;
}

void CellOccluders::add_plane(size_t k, const PlaneLines& plane, const PlaneRadiance* radiance) {
  const float half = light_->half_width[lit_[k]];
  if (turns_away(plane, ball_, half)) return;
  if (!indirect_ && distance_ == k_infinity && hides(plane, ball_, half)) {
    clear_[k] = 0.0f;
    return;
  }
  planes_[k].push_back(plane);
  planes_[k].back().radiance = radiance;
}

void CellOccluders::add(const SkyOccluder& o, const ShadingPointBatch& points) {
  const bool is_self = o.instance == points.instance[0];
  const bool by_faces = o.kind == SkyOccluder::Kind::box && !is_self && find_seen_faces(o, points);
  const Vec3 to = glm::transpose(grid_) * (o.ball.centre - ball_.centre);
  const float distance = glm::length(to), reach = o.ball.radius + ball_.radius;
  float least = -k_infinity;
  if (distance > reach) {
    // The texels that the farthest point reads: powers of two up to the whole map, which then widens.
    const float wanted = k_footprint * sky_->cell_width() * (distance + ball_.radius) / (2.0f * o.half_map);
    const float texel = wanted < 1.0f ? std::exp2(std::ceil(std::log2(wanted) - 0.499f)) : wanted;
    // What is seen of other kinds reaches as far as the cell's corners.
    const float beyond =
        o.kind == SkyOccluder::Kind::map ? k_read_reach * texel * 2.0f * o.half_map / distance : sky_->cell_width();
    const float angle = std::asin(reach / distance) + beyond;
    if (angle < k_pi) least = std::cos(angle) * distance;
  }
  const Mat3 to_maps = glm::transpose(o.grid) * grid_;
  find_facing(to, least);
  for_facing([&](size_t k) {
    if (clear_[k] == 0.0f) return;
    const Vec3 d(lit_x_[k], lit_y_[k], lit_z_[k]);
    switch (o.kind) {
      case SkyOccluder::Kind::map: {
        const Vec3 unit = to_maps * d;
        const MapLines lines =
            map_lines(o, *sky_, direction_cell(unit, sky_->directions()), unit, cell(k).width(), distance_);
        if (indirect_) {
          insert(k, o, lines);
        } else {
          maps_[k].push_back(lines);
        }
        break;
      }
      case SkyOccluder::Kind::plane:
        add_plane(k, plane_lines(o, grid_ * d), indirect_ ? indirect_->plane_radiance(o, 0) : nullptr);
        break;
      case SkyOccluder::Kind::box:
        if (by_faces) {
          for (const SeenFace& seen : seen_faces_) {
            PlaneLines plane = face_lines(o, seen.face, grid_ * d);
            plane.least_height = seen.plane.least_height;
            add_plane(k, plane, indirect_ ? indirect_->plane_radiance(o, seen.face) : nullptr);
            if (clear_[k] == 0.0f) break;
          }
          break;
        }
        [[fallthrough]];
      case SkyOccluder::Kind::ball:
        balls_[k].push_back({{o.ball.centre.x, o.ball.centre.y, o.ball.centre.z}, o.ball.radius});
        break;
    }
  });
}

// Keeps maps in the order of their places, which no batch changes.
void CellOccluders::insert(size_t k, const SkyOccluder& o, const MapLines& lines) {
  const MapRadiance radiance = indirect_->map_radiance(o, direction(k), cell(k).width());
  std::vector<MapRadiance>& all = radiance_[k];
  const auto at = std::upper_bound(all.begin(), all.end(), radiance.place,
                                   [](float place, const MapRadiance& other) { return place < other.place; });
  maps_[k].insert(maps_[k].begin() + (at - all.begin()), lines);
  all.insert(at, radiance);
}

// By directions all over each cell: what groups along the horizon hide of a cell is often the same part. A crowd's
// cells are the world's.
void CellOccluders::add_far() {
  clear_.assign(lit_.size(), 1.0f);
  if (lobes_.empty()) return;
  const PartDirections parts = sky_->parts();
  far_clear_.assign(size_t(parts.blocks * k_part_block), 1.0f);
  far_blocks_.resize(size_t(parts.blocks) + k_batch_padding);
  const auto hide_by_lobe = cell_kernels(resolve_isa(Isa::automatic)).hide_by_lobe;  // the same bits by any
  for (const GroupLobe& lobe : lobes_) hide_by_lobe(lobe, parts, far_blocks_.data(), far_clear_.data());
  for (size_t k = 0; k < lit_.size(); ++k) {
    const SkyCell& cell = this->cell(k);
    const int divisions = cell.side / sky_->directions(), side = k_group_parts / divisions;
    const float* const first =
        &far_clear_[size_t(cell.within(sky_->directions()) * k_part_block + cell.u % divisions * side * k_group_parts +
                           cell.v % divisions * side)];
    float sum = 0.0f;
    for (int i = 0; i < side; ++i) {
      for (int j = 0; j < side; ++j) sum += first[i * k_group_parts + j];
    }
    clear_[k] = sum / float(side * side);
  }
}

void CellOccluders::find(const Sky& sky, const ShadingPointBatch& points, const Sphere& place) {
  const SkyMaps& maps = sky.maps();
  sky_ = &maps;
  light_ = &sky.cells_of(points.instance[0]);
  indirect_ = sky.indirect();
  distance_ = sky.distance();
  const SkyOccluder& self = maps.occluders()[points.instance[0]];
  grid_ = self.cells;
  own_ = self.kind == SkyOccluder::Kind::map && !self.is_flat ? &self : nullptr;
  bent_ = self.is_bent;
  count_ = points.size;
  bound(points);
  find_lit();
  // From the points' middle: the place's may be so far off that the horizon's groups stand elsewhere.
  maps.find(place, ball_.centre, distance_, near_, lobes_);
  add_far();
  // What is made of planes before others, which do not matter where one hides a cell.
  for (const bool planes : {true, false}) {
    for (const uint32_t i : near_) {
      const SkyOccluder& o = maps.occluders()[i];
      if ((o.kind == SkyOccluder::Kind::plane || o.kind == SkyOccluder::Kind::box) != planes) continue;
      // Nothing is known of a ball's inside, not even to points on the object, nor of a box's from within.
      if (&o == &self) {
        const bool is_box = o.kind == SkyOccluder::Kind::box, is_ball = o.kind == SkyOccluder::Kind::ball;
        if (!(is_box && faces_inwards(o, points)) && !(is_ball && !o.is_flat)) continue;
      }
      if (o.is_flat && self.is_flat && holds(o, self.ball, points, 0)) continue;
      if (is_reached(o)) add(o, points);
    }
  }
}

bool CellOccluders::reads_own_alike(size_t a, size_t b) const {
  // Within a distance, how far counts goes by the part's own direction.
  if (!own_ || own_->cells != own_->grid || distance_ < k_infinity || a >= lit_.size() || b >= lit_.size())
    return false;
  const int directions = sky_->directions();
  return cell(a).side > directions && cell(b).side > directions &&
         cell(a).within(directions) == cell(b).within(directions);
}

CellTask CellOccluders::task(size_t k, OwnObject& own) const {
  const SkyCells& light = *light_;
  const uint32_t cell = lit_[k];
  const Vec3 direction = this->direction(k);
  const float width = this->cell(k).width(), solid_angle = width * width;
  const float weight[3] = {light.red[cell], light.green[cell], light.blue[cell]};
  const float vector[3] = {light.vx[cell], light.vy[cell], light.vz[cell]};
  CellTask task;
  for (int a = 0; a < 3; ++a) {
    task.direction[a] = direction[a];
    task.vector[a] = vector[a];
    task.weight[a] = weight[a] * solid_angle;
  }
  task.clear = clear_[k];
  task.within = distance_;
  task.half = 0.5f * width;
  task.cosine_half = light.half_width[cell];
  task.reflects = indirect_ != nullptr;
  task.bent = bent_;
  if (clear_[k] == 0.0f) return task;
  if (own_) {
    const bool own_cells = own_->cells == own_->grid;
    const Vec3 unit = own_cells ? light.directions[cell] : glm::transpose(own_->grid) * direction;
    const int map = own_cells ? this->cell(k).within(sky_->directions()) : direction_cell(unit, sky_->directions());
    const Mat3 axes = own_->grid * sky_->frame(map);
    OwnLines& o = own.lines;
    o.lines = map_lines(*own_, *sky_, map, unit, width, distance_);
    o.clear_within = sky_->tolerance().clear_within;
    o.hidden_from = sky_->tolerance().hidden_from;
    if (this->cell(k).side > sky_->directions()) o.clear_within *= k_divided_clear;
    for (int a = 0; a < 3; ++a) o.s[a] = axes[0][a], o.t[a] = axes[1][a], o.c[a] = axes[2][a];
    task.own = &o;
    if (indirect_) {
      own.radiance = indirect_->map_radiance(*own_, direction, width);
      task.own_radiance = &own.radiance;
    }
  }
  task.maps = maps_[k].data(), task.map_count = int(maps_[k].size());
  task.map_radiance = radiance_[k].data();
  task.planes = planes_[k].data(), task.plane_count = int(planes_[k].size());
  task.balls = balls_[k].data(), task.ball_count = int(balls_[k].size());
  return task;
}

}  // namespace fieldtrace
