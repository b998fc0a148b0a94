#include "hybrid/glossy/radiance_maps.h"

#include <algorithm>
#include <chrono>

#include "core/math/barycentric.h"
#include "core/platform/stopwatch.h"
#include "field/bake/tile_lines.h"
#include "field/store/field.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shadow_instance.h"

namespace fieldtrace {
namespace {

// Patch edges about as long as the spacing of lines.
float patch_of(const Scene& scene, uint32_t instance, int lines) {
  const Instance& placed = scene.instances[instance];
  const Sphere ball = field_ball(scene.shapes[placed.shape].bounds);
  float narrowest = k_infinity;
  for (int axis = 0; axis < 3; ++axis) narrowest = std::min(narrowest, glm::length(Vec3(placed.to_world[axis])));
  return 2.0f * ball.radius * narrowest / float(lines);
}

}  // namespace

uint64_t RadianceMaps::count_patches(const Scene& scene, uint32_t instance) {
  return SurfaceRadiance::count_patches(scene, instance, patch_of(scene, instance, 2 * k_plane));
}

uint64_t RadianceMaps::tile_bytes() { return CoverageTiles::pool_bytes(k_directions, k_plane, TilePayload::radiance); }

RadianceMaps::RadianceMaps(const TransportContext& shading, uint32_t instance)
    : scene_(shading.scene),
      accel_(shading.accel),
      ball_(field_ball(scene_.shapes[scene_.instances[instance].shape].bounds)),
      tiles_(k_directions, k_plane, nullptr, TilePayload::radiance),
      radiance_(shading, instance, patch_of(scene_, instance, tiles_.lines())) {
  AnswererSettings settings;
  settings.tolerance = 1.0f;
  task_ = make_shadow_instance(scene_, instance, {}, nullptr, nullptr, settings).cone;
  task_.segment.field.directions = make_axis(k_directions);
  task_.segment.field.coverage = tiles_.view();
}

SurfaceRadiance::Side RadianceMaps::side_at(uint32_t triangle, const Vec2& uv, const Vec3& direction) const {
  const Instance& placed = scene_.instances[instance()];
  const TriangleMesh& mesh = scene_.shapes[placed.shape].mesh;
  const UVec3 t = mesh.triangles[triangle];
  const Vec3 normal = glm::cross(mesh.positions[t.y] - mesh.positions[t.x], mesh.positions[t.z] - mesh.positions[t.x]);
  const bool behind = (glm::dot(normal, direction) > 0.0f) != placed.flip_normals;
  return radiance_.side_at(triangle, uv.x, uv.y, behind);
}

Rgb RadianceMaps::radiance_at(const HitBatch& hits, size_t i, const Vec3& direction) {
  const Vec3 d = Mat3(scene_.instances[instance()].to_object) * direction;
  const SurfaceRadiance::Side side[] = {side_at(hits.primitive[i], {hits.u[i], hits.v[i]}, d)};
  radiance_.shade(side);
  return radiance_.radiance(side[0]);
}

void RadianceMaps::bake(std::span<const uint32_t> slots, Stats& stats) {
  const auto start = std::chrono::steady_clock::now();
  const Instance& placed = scene_.instances[instance()];
  const TriangleMesh& mesh = scene_.shapes[placed.shape].mesh;
  TileRays rays;
  ShapeHits hits;
  TileLines lines;
  std::vector<SurfaceRadiance::Side> sides;
  std::vector<int> texels;  // of `sides`
  std::vector<Rgb> colours;
  uint64_t bake_rays = 0;
  bake_tiles(tiles_, slots, [&](uint32_t slot) {
    rays.lay(tiles_, slot, ball_, k_directions);
    const size_t count = rays.texels.size();
    lines.assign(CoverageTiles::k_lines_per_tile, 0);
    sides.clear();
    texels.clear();
    hits.resize(count);
    if (count > 0) accel_.shape_intersect(placed.shape, rays.rays, hits);
    bake_rays += count;
    for (size_t r = 0; r < count; ++r) {
      if (hits.t[r] < 0.0f) continue;
      lines[size_t(rays.texels[r])] = rays.line_at(r, hits.t[r]);
      const UVec3 t = mesh.triangles[hits.primitive[r]];
      const Vec3 p0 = mesh.positions[t.x], e1 = mesh.positions[t.y] - p0, e2 = mesh.positions[t.z] - p0;
      const Vec3 d = rays.rays.direction(r), p = rays.rays.origin(r) + d * hits.t[r];
      sides.push_back(side_at(hits.primitive[r], barycentric(DVec3(p0), DVec3(e1), DVec3(e2), DVec3(p)), d));
      texels.push_back(rays.texels[r]);
    }
    bake_rays += radiance_.shade(sides);
    colours.assign(CoverageTiles::k_lines_per_tile, Rgb(0.0f));
    for (size_t k = 0; k < sides.size(); ++k) colours[size_t(texels[k])] = radiance_.radiance(sides[k]);
    tiles_.finish(slot, lines, colours);
  });
  stats.add_bake({bake_rays, seconds_since(start)});
}

}  // namespace fieldtrace
