#include "hybrid/sky/surfels.h"

#include <algorithm>

#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "field/bake/cell_lines.h"
#include "hybrid/sky/affine_rows.h"

namespace fieldtrace {
namespace {

// Voxels along each axis of [-1, 1]^3, and main directions of normals.
constexpr int k_voxels = 16, k_faces = 6;  // the former a power of two
// Surfaces that a line meets at most; in units of the ball's radius, how far beyond one it goes on.
constexpr int k_most_layers = 8;
constexpr float k_beyond = 1e-4f;

// A closed surface is met by lines from one side first and from the other last. The share of lines that may meet it
// otherwise: at edges and small holes.
constexpr float k_most_unlike_closed = 0.02f;

// What lines of one direction meet.
struct Met {
  SurfaceSpot spot;
  Vec3 normal;       // unit, towards the line's beginning
  uint32_t key;      // of voxel and face
  float off_centre;  // squared distance from the voxel's middle, unit space
  bool is_first, is_front;
};
struct DirectionHits {
  std::vector<Met> met;
  // By texel: index into met, or k_none.
  std::vector<uint32_t> first, last_front, last_back;
};

// Which sides of a closed surface lie outside.
enum class Outside { fronts, backs, unknown };

bool is_seen(const Met& met, Outside outside) { return met.is_first || met.is_front == (outside == Outside::fronts); }

// `unit`, `normal`: in the space of the shape's ball.
Met meet(const Vec3& unit, const Vec3& normal, uint32_t primitive, const MappedShape& shape, const DMat3& to_object) {
  Met met = {};
  met.spot = {Vec3(to_object * DVec3(shape.ball.centre + unit * shape.ball.radius)), primitive};
  met.normal = Vec3(glm::normalize(shape.stretch * DVec3(normal)));  // by the inverse transpose of to_object
  const Vec3 place = (unit + 1.0f) * (0.5f * float(k_voxels));
  uint32_t voxel = 0;  // in Morton order
  met.off_centre = 0.0f;
  for (int a = 0; a < 3; ++a) {
    const int i = std::clamp(int(place[a]), 0, k_voxels - 1);
    const float off = place[a] - (float(i) + 0.5f);
    for (int bit = 0; 1 << bit < k_voxels; ++bit) voxel |= (uint32_t(i) >> bit & 1u) << (3 * bit + a);
    met.off_centre += off * off;
  }
  met.key = voxel * uint32_t(k_faces) + uint32_t(box_face_at(normal));
  return met;
}

// One line of a direction.
struct SurfaceLine {
  Vec3 entry;  // unit space
  float at = 0.0f, length;
  uint32_t texel;
};

DirectionHits hits_along(const Accel& accel, const MappedShape& shape, const DMat3& to_object, const CellFrame& frame,
                         int texels) {
  const Sphere& ball = shape.ball;
  const auto in_object = [&](const Vec3& v) { return Vec3(to_object * DVec3(v)); };
  DirectionHits result;
  result.first.assign(size_t(texels) * size_t(texels), k_none);
  result.last_front = result.last_back = result.first;
  std::vector<SurfaceLine> lines, going_on;
  for (int i = 0; i < texels * texels; ++i) {
    const auto line = line_of_texel(frame, i % texels, i / texels, texels);
    if (line) lines.push_back({line->foot - frame.c * line->half, 0.0f, 2.0f * line->half, uint32_t(i)});
  }
  RayBatch rays;
  ShapeHits hits;
  for (int layer = 0; layer < k_most_layers && !lines.empty(); ++layer) {
    rays.resize(lines.size());
    hits.resize(lines.size());
    for (size_t r = 0; r < lines.size(); ++r) {
      const Vec3 from = lines[r].entry + frame.c * lines[r].at;
      rays.set(r, in_object(ball.centre + from * ball.radius), in_object(frame.c * ball.radius),
               lines[r].length - lines[r].at);
    }
    accel.shape_intersect(shape.shape, rays, hits);
    going_on.clear();
    for (size_t r = 0; r < lines.size(); ++r) {
      if (hits.t[r] < 0.0f) continue;
      SurfaceLine line = lines[r];
      line.at += hits.t[r];
      const Vec3 n(glm::transpose(to_object) * DVec3(hits.nx[r], hits.ny[r], hits.nz[r]));
      const float length = glm::length(n), along = glm::dot(n, frame.c);
      const auto index = uint32_t(result.met.size());
      const Vec3 unit = length > 0.0f ? n / length : -frame.c;
      Met met = meet(line.entry + frame.c * line.at, along > 0.0f ? -unit : unit, hits.primitive[r], shape, to_object);
      met.is_first = result.first[line.texel] == k_none;
      met.is_front = along < 0.0f;
      if (met.is_first) result.first[line.texel] = index;
      (met.is_front ? result.last_front : result.last_back)[line.texel] = index;
      result.met.push_back(met);
      line.at += k_beyond;
      if (line.at < line.length) going_on.push_back(line);
    }
    lines.swap(going_on);
  }
  return result;
}

// Where lines meet no more than one surface it does not matter.
Outside outside_of(std::span<const DirectionHits> hits) {
  size_t lines = 0, several = 0, by_front = 0, by_back = 0;
  for (const DirectionHits& d : hits) {
    for (size_t t = 0; t < d.first.size(); ++t) {
      if (d.first[t] == k_none) continue;
      const uint32_t front = d.last_front[t], back = d.last_back[t];
      ++lines;
      several += d.first[t] != (front == k_none ? back : back == k_none ? front : std::max(front, back));
      if (front == k_none || back == k_none) continue;
      (d.met[d.first[t]].is_front ? by_front : by_back) += d.met[d.first[t]].is_front == (back > front);
    }
  }
  const auto most = size_t(k_most_unlike_closed * float(lines));
  if (several <= most || by_front + most >= lines) return Outside::fronts;
  return by_back + most >= lines ? Outside::backs : Outside::unknown;
}

}  // namespace

Surfels make_surfels(const Accel& accel, const MappedShape& shape, int directions, int texels) {
  const DMat3 to_object = shape.is_deformed() ? glm::inverse(shape.stretch) : DMat3(1.0);
  std::vector<DirectionHits> hits(size_t(directions) * size_t(directions));
  parallel_for(hits.size(), [&](size_t i) {
    const CellFrame frame = cell_frame(int(i) / directions, int(i) % directions, directions);
    hits[i] = hits_along(accel, shape, to_object, frame, texels);
  });
  const Outside outside = outside_of(hits);
  if (outside == Outside::unknown) return {};
  constexpr size_t k_keys = size_t(k_voxels) * k_voxels * k_voxels * k_faces;
  std::vector<uint32_t> of_key(k_keys, k_none);
  for (const DirectionHits& of_direction : hits) {
    for (const Met& met : of_direction.met) {
      if (is_seen(met, outside)) of_key[met.key] = 0;
    }
  }
  Surfels result;
  uint32_t count = 0;
  constexpr size_t k_eight_voxels = size_t(k_faces) * 8;  // side by side in Morton order
  uint32_t first[k_faces];
  for (size_t key = 0; key < k_keys; ++key) {
    if (key % k_eight_voxels == 0) std::fill_n(first, k_faces, k_none);
    uint32_t& point = of_key[key];
    if (point == k_none) continue;
    point = count++;
    uint32_t& of_face = first[key % k_faces];
    if (of_face == k_none) of_face = point;
    result.representative.push_back(of_face);
  }
  // The hit nearest to the middle of its voxel stands for all.
  result.points.resize(count);
  result.reflectance_spots.resize(size_t(count) * Surfels::k_reflectance_spots);
  std::vector<uint32_t> counts(count, 0);
  std::vector<float> off_centre(count, k_infinity);
  for (const DirectionHits& of_direction : hits) {
    for (const Met& met : of_direction.met) {
      if (!is_seen(met, outside)) continue;
      const size_t point = of_key[met.key];
      SurfaceSpot* const spots = &result.reflectance_spots[point * size_t(Surfels::k_reflectance_spots)];
      spots[counts[point]++ % uint32_t(Surfels::k_reflectance_spots)] = met.spot;
      if (!(met.off_centre < off_centre[point])) continue;
      result.points[point] = {met.spot, met.normal};
      off_centre[point] = met.off_centre;
    }
  }
  // Fewer hits than places count alike, as far as they go.
  for (size_t point = 0; point < count; ++point) {
    SurfaceSpot* const spots = &result.reflectance_spots[point * size_t(Surfels::k_reflectance_spots)];
    for (uint32_t k = counts[point]; k < uint32_t(Surfels::k_reflectance_spots); ++k)
      spots[k] = spots[k % counts[point]];
  }
  for (const DirectionHits& of_direction : hits) {
    const auto point_of = [&](uint32_t i) { return i == k_none ? k_none : of_key[of_direction.met[i].key]; };
    for (const uint32_t i : of_direction.first) result.texels.push_back(point_of(i));
    for (size_t t = 0; t < of_direction.first.size(); ++t) {
      const uint32_t last = (outside == Outside::fronts ? of_direction.last_front : of_direction.last_back)[t];
      result.texels.push_back(point_of(last == k_none ? of_direction.first[t] : last));
    }
  }
  return result;
}

Surfels make_plane_surfels(const Accel& accel, uint32_t shape, const Parallelogram& plane, const Vec3& normal,
                           std::span<const PlaneWindow> windows, int texels, const bool sides[2]) {
  constexpr int k_spots = Surfels::k_reflectance_spots;
  const auto height = float(glm::length(plane.axes[0]) + glm::length(plane.axes[1]));
  const auto texel_count = size_t(texels) * size_t(texels);
  Surfels result;
  RayBatch rays;
  ShapeHits hits;
  for (size_t w = 0; w < windows.size(); ++w) {
    const PlaneWindow& window = windows[w];
    // The middle of each texel, and its places of reflectance.
    const size_t count = texel_count * size_t(1 + k_spots);
    rays.resize(count);
    hits.resize(count);
    const auto coordinates = [&](size_t i) {
      const size_t texel = i / (1 + k_spots), spot = i % (1 + k_spots);
      const auto u = scalar::sample_2d(uint32_t(spot), uint32_t(texel), 0);
      const Vec2 within = spot == 0 ? Vec2(0.5f) : Vec2(u.x, u.y);
      const Vec2 at = (Vec2(float(texel % size_t(texels)), float(texel / size_t(texels))) + within) / float(texels);
      return window.lower + (window.upper - window.lower) * at;
    };
    const auto is_in_later = [&](const Vec2& c) {
      return std::any_of(windows.begin() + std::ptrdiff_t(w) + 1, windows.end(), [&](const PlaneWindow& later) {
        return glm::all(glm::lessThan(later.lower, c)) && glm::all(glm::lessThan(c, later.upper));
      });
    };
    const auto place = [&](size_t i) {
      const Vec2 c = coordinates(i);
      return Vec3(plane.centre + plane.axes[0] * double(c.x) + plane.axes[1] * double(c.y));
    };
    for (size_t i = 0; i < count; ++i) rays.set(i, place(i) + normal * height, -normal, 2.0f * height);
    accel.shape_intersect(shape, rays, hits);
    for (int side = 0; side < 2; ++side) {
      const size_t begin = result.texels.size();
      for (size_t texel = 0; texel < texel_count; ++texel) {
        const size_t first = texel * (1 + k_spots);
        if (!sides[side] || hits.t[first] < 0.0f || is_in_later(coordinates(first))) {
          result.texels.push_back(k_none);
          continue;
        }
        const auto point = uint32_t(result.points.size());
        result.texels.push_back(point);
        const size_t of_four = texel - texel % 2 - texel / size_t(texels) % 2 * size_t(texels);
        const uint32_t nearby = result.texels[begin + of_four];
        result.representative.push_back(nearby == k_none ? point : nearby);
        result.points.push_back({{place(first), hits.primitive[first]}, side == 0 ? normal : -normal});
        for (size_t i = first + 1; i <= first + k_spots; ++i) {
          const size_t from = hits.t[i] < 0.0f ? first : i;  // rounding at the edge
          result.reflectance_spots.push_back({place(from), hits.primitive[from]});
        }
      }
    }
  }
  return result;
}

}  // namespace fieldtrace
