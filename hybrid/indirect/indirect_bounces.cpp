#include "hybrid/indirect/indirect_bounces.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "core/math/barycentric.h"
#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/path/patch_vertex.h"

namespace fieldtrace {
namespace {

constexpr uint32_t k_surfel_stream = 0x53524645u;
// Surfels that are shaded together.
constexpr size_t k_surfel_block = 256;
// --check: one block in so many.
constexpr size_t k_check_blocks = 2;
// Bounces that are shaded at most. Where more are wanted, what remains is a geometric series, of at most this ratio;
// none further is shaded once it is no more than this part of all.
constexpr int k_most_bounces = 16;
constexpr float k_least_rest = 0.01f, k_most_ratio = 0.99f;

using SurfelRadiance = std::vector<std::vector<Rgb>>;  // by instance and surfel

// Points of an instance that are shaded together.
struct Block {
  uint32_t instance;
  std::vector<uint32_t> points;
};

// The surfels that stand for others: of each few side by side, one.
using Representatives = std::vector<std::vector<uint32_t>>;  // by instance and surfel

// A surfel stands for itself where that one cannot tell what it sends: light that it does not reflect, or that does not
// reach it, such as below a ground.
Representatives representatives(const IndirectLight& light, const SurfelRadiance& radiance,
                                const SurfelRadiance& reflectance) {
  Representatives result;
  for (size_t i = 0; i < light.size(); ++i) {
    std::vector<uint32_t>& of = result.emplace_back(light.surfels(i).representative);
    for (uint32_t k = 0; k < of.size(); ++k) {
      const uint32_t r = of[k];
      for (int c = 0; c < 3; ++c) {
        const bool is_dead = !(reflectance[i][r][c] > 0.0f) && reflectance[i][k][c] > 0.0f;
        const bool is_dark = !(radiance[i][r][c] > 0.0f) && radiance[i][k][c] > 0.0f;
        if (is_dead || is_dark) of[k] = k;
      }
    }
  }
  return result;
}

// is_wanted(instance, point): whether a surfel is shaded.
template <class IsWanted>
std::vector<Block> make_blocks(const IndirectLight& light, const IsWanted& is_wanted) {
  std::vector<Block> blocks;
  for (uint32_t i = 0; i < light.size(); ++i) {
    bool is_full = true;
    for (uint32_t point = 0; point < light.surfels(i).points.size(); ++point) {
      if (!is_wanted(i, point)) continue;
      if (is_full) blocks.push_back({i, {}});
      blocks.back().points.push_back(point);
      is_full = blocks.back().points.size() == k_surfel_block;
    }
  }
  return blocks;
}

Vec2 place_on_triangle(const TriangleMesh& mesh, const SurfaceSpot& spot) {
  const UVec3& t = mesh.triangles[spot.primitive];
  const DVec3 p0(mesh.positions[t.x]);
  return barycentric(p0, DVec3(mesh.positions[t.y]) - p0, DVec3(mesh.positions[t.z]) - p0, DVec3(spot.position));
}

// Shades the surfels of a scene once.
class SurfelShader {
 public:
  SurfelShader(const TransportContext& shading, const IndirectLight& light)
      : scene_(shading.scene),
        seed_(shading.settings.seed),
        lobe_samples_(float(shading.settings.lobe_samples)),
        light_(light),
        followers_([&shading] { return make_path_follower(shading); }) {}

  // What leaves the block's surfels, in order, and their reflectance. Returns the number of rays traced.
  uint64_t shade(const Block& block, std::span<Rgb> leaving, std::span<Rgb> reflectance) {
    const size_t count = block.points.size();
    std::vector<PathVertex> vertices;
    std::vector<PathState> paths;
    std::vector<SurfacePoint> surfaces(count);  // what the vertices refer to
    std::vector<Material> materials(count);
    std::vector<uint32_t> lit;  // not those of which nothing leaves
    SpotRay ray;
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t point = block.points[i];
      const PathVertex vertex = vertex_at(block.instance, point, ray, surfaces[i], materials[i]);
      leaving[i] = Rgb(0.0f);
      reflectance[i] = materials[i].dark ? Rgb(0.0f) : materials[i].reflectance;
      if (reflectance[i] == Rgb(0.0f)) continue;
      lit.push_back(i);
      vertices.push_back(vertex);
      paths.emplace_back().pixel_seed =
          scalar::pixel_seed(seed_, point, scalar::hash_combine(block.instance, k_surfel_stream));
    }
    if (lit.empty()) return 0;
    std::vector<Rgb> of_lit(lit.size());
    const uint64_t rays = followers_.local()->follow(vertices, paths, of_lit);
    for (size_t k = 0; k < lit.size(); ++k) leaving[lit[k]] = of_lit[k];
    return rays;
  }

 private:
  // A ray that ends on a spot, with room for one: surfels are many.
  struct SpotRay {
    SpotRay() {
      rays.resize(1);
      hits.resize(1);
    }
    RayBatch rays;
    HitBatch hits;
  };

  SurfacePoint surface_of(uint32_t instance, const SurfaceSpot& spot, SpotRay& ray) const {
    const Instance& of = scene_.instances[instance];
    HitBatch& hits = ray.hits;
    hits.instance[0] = instance, hits.primitive[0] = spot.primitive, hits.t[0] = 0.0f;
    const Shape& shape = scene_.shapes[of.shape];
    if (is_meshed(shape.kind)) {
      const Vec2 at = place_on_triangle(shape.mesh, spot);
      hits.u[0] = at.x, hits.v[0] = at.y;
    }
    ray.rays.set(0, transform_point(of.to_world, spot.position), Vec3(0.0f, 0.0f, 1.0f), 0.0f);
    return surface_at(scene_, ray.rays, hits, 0);
  }

  PathVertex vertex_at(uint32_t instance, uint32_t point, SpotRay& ray, SurfacePoint& surface,
                       Material& material) const {
    const Surfels& surfels = light_.surfels(instance);
    const Surfel& surfel = surfels.points[point];
    const Instance& of = scene_.instances[instance];
    surface = surface_of(instance, surfel.spot, ray);
    // Normals are transformed by the inverse transpose.
    const Mat3 to_object(of.to_object[0], of.to_object[1], of.to_object[2]);
    const bool back = glm::dot(glm::transpose(to_object) * surfel.normal, surface.geometric_normal) < 0.0f;
    PathVertex v = patch_vertex(scene_, surface, back, material);
    if (is_textured(scene_, of.bsdf)) {
      Rgb sum(0.0f);
      for (size_t k = 0; k < size_t(Surfels::k_reflectance_spots); ++k) {
        const SurfaceSpot& spot = surfels.reflectance_spots[point * size_t(Surfels::k_reflectance_spots) + k];
        const Vec2 uv = surface_of(instance, spot, ray).uv;
        sum += resolve_material(scene_, of.bsdf, uv, is_turned(surface, back) ? -1.0f : 1.0f).reflectance;
      }
      material.reflectance = sum / float(Surfels::k_reflectance_spots);
    }
    v.seed = scalar::vertex_seed(seed_, point, instance, k_surfel_stream);
    v.lobe_samples = lobe_samples_;
    return v;
  }

  const Scene& scene_;
  uint32_t seed_;
  float lobe_samples_;
  const IndirectLight& light_;
  tbb::enumerable_thread_specific<std::unique_ptr<PathFollower>> followers_;
};

// The mean over all surfels of what has changed between two bounces, in units of what leaves them `now`: a dim room
// counts as much as the bright ground outside.
DVec3 mean_change(const SurfelRadiance& before, const SurfelRadiance& after, const SurfelRadiance& now) {
  DVec3 sum(0.0);
  size_t count = 0;
  for (size_t i = 0; i < now.size(); ++i) {
    for (size_t k = 0; k < now[i].size(); ++k) {
      const float unit = std::max(luminance(now[i][k]), luminance(before[i][k]));
      if (!(unit > 0.0f)) continue;
      sum += DVec3(after[i][k] - before[i][k]) / double(unit);
      ++count;
    }
  }
  return count ? sum / double(count) : sum;
}

// What `further` bounces (infinity: all) bring, if each is `ratio` of the one before, as a multiple of the last one.
DVec3 rest_of(const DVec3& ratio, double further) {
  const DVec3 q = glm::clamp(ratio, DVec3(0.0), DVec3(k_most_ratio));
  return q * (1.0 - glm::pow(q, DVec3(further))) / (1.0 - q);
}

// Adds that: the last bounce is what has changed since `before`.
void add_series(const SurfelRadiance& before, const Rgb& rest, SurfelRadiance& radiance) {
  for (size_t i = 0; i < radiance.size(); ++i) {
    for (size_t k = 0; k < radiance[i].size(); ++k) {
      radiance[i][k] += glm::max(radiance[i][k] - before[i][k], Rgb(0.0f)) * rest;
    }
  }
}

// What a bounce changes is smooth: surfels that were not shaded change as those that stand for them did since `before`,
// in proportion to their reflectance.
void add_to_others(std::span<const uint32_t> representative, std::span<const Rgb> before,
                   std::span<const Rgb> reflectance, std::span<Rgb> radiance) {
  for (size_t k = 0; k < radiance.size(); ++k) {
    const size_t r = representative[k];
    if (r == k) continue;
    const Rgb change = radiance[r] - before[r];
    for (int c = 0; c < 3; ++c) {
      if (!(reflectance[r][c] > 0.0f)) continue;
      radiance[k][c] = std::max(before[k][c] + change[c] * (reflectance[k][c] / reflectance[r][c]), 0.0f);
    }
  }
}

// Every k-th block of surfels is compared with exact paths, by the mean over the block: paths are noisy.
void check_surfels(std::span<const Block> blocks, const SurfelRadiance& radiance, const TransportContext& exact,
                   const IndirectLight& light, Stats& stats) {
  SurfelShader shader(exact, light);
  const float mean = light.mean_luminance();
  if (!(mean > 0.0f)) return;
  std::vector<double> differences((blocks.size() + k_check_blocks - 1) / k_check_blocks);
  parallel_for(differences.size(), [&](size_t k) {
    const Block& b = blocks[k * k_check_blocks];
    std::vector<Rgb> leaving(b.points.size()), reflectance(b.points.size());
    shader.shade(b, leaving, reflectance);
    double sum = 0.0;
    for (size_t i = 0; i < leaving.size(); ++i) {
      sum += double(luminance(radiance[b.instance][b.points[i]]) - luminance(leaving[i]));
    }
    differences[k] = sum / double(leaving.size());
  });
  for (const double d : differences) stats.checked(CheckedEstimate::surfels).add(d, double(mean));
}

}  // namespace

void shade_indirect(const std::shared_ptr<IndirectLight>& light, Sky& sky, TransportContext& shading, int bounces,
                    const TransportContext* exact, const std::atomic<bool>* stop, Stats& stats) {
  const auto stopped = [&] { return stop && stop->load(std::memory_order_relaxed); };
  double seconds = 0.0;
  std::optional<ScopedTimer> timer(seconds);
  const std::vector<Block> all_blocks = make_blocks(*light, [](uint32_t, uint32_t) { return true; });
  std::vector<Block> few_blocks;
  Representatives stand_for;
  SurfelRadiance radiance(light->size());
  for (size_t i = 0; i < radiance.size(); ++i) radiance[i].resize(light->surfels(i).points.size());
  SurfelRadiance reflectance = radiance;
  std::atomic<uint64_t> rays = 0;
  const bool adds_series = bounces < 0 || bounces > k_most_bounces;
  const int most = adds_series ? k_most_bounces : bounces;
  sky.set_indirect(nullptr);
  SurfelRadiance before, two_before;
  for (int bounce = 0; bounce < most && !stopped(); ++bounce) {
    two_before = std::exchange(before, radiance);
    // What comes by way of mirrors and glass takes more of a path's length than a bounce.
    if (bounces >= 0) shading.settings.max_depth = bounce + 2;
    SurfelShader shader(shading, *light);
    const std::vector<Block>& blocks = bounce == 0 ? all_blocks : few_blocks;
    parallel_for(blocks.size(), [&](size_t i) {
      if (stopped()) return;
      const Block& b = blocks[i];
      std::vector<Rgb> leaving(b.points.size()), reflecting(b.points.size());
      rays += shader.shade(b, leaving, reflecting);
      for (size_t k = 0; k < b.points.size(); ++k) {
        radiance[b.instance][b.points[k]] = leaving[k];
        reflectance[b.instance][b.points[k]] = reflecting[k];
      }
    });
    if (stopped()) break;
    if (bounce == 0) {
      stand_for = representatives(*light, radiance, reflectance);
      few_blocks = make_blocks(*light, [&](uint32_t i, uint32_t point) { return stand_for[i][point] == point; });
    } else {
      for (size_t i = 0; i < radiance.size(); ++i) {
        add_to_others(stand_for[i], before[i], reflectance[i], radiance[i]);
      }
    }
    bool is_last = false;
    if (adds_series && bounce > 0) {
      const DVec3 change = mean_change(before, radiance, radiance);
      const DVec3 change_before = mean_change(two_before, before, radiance);
      const double further = bounces < 0 ? double(k_infinity) : double(bounces - (bounce + 1));
      const DVec3 rest = rest_of(change / glm::max(change_before, DVec3(1e-30)), further);
      is_last = luminance(Rgb(change * rest)) <= k_least_rest || bounce + 1 == most;
      if (is_last) add_series(before, Rgb(rest), radiance);
    }
    parallel_for(radiance.size(), [&](size_t i) { light->set_radiance(i, radiance[i]); });
    light->finish();
    sky.set_indirect(light);
    if (is_last) break;
  }
  stats.bake_rays += rays;
  timer.reset();
  stats.time_bake += seconds * double(tbb::this_task_arena::max_concurrency());
  if (stopped()) {
    sky.set_indirect(nullptr);
  } else if (exact) {
    check_surfels(all_blocks, radiance, *exact, *light, stats);
  }
}

}  // namespace fieldtrace
