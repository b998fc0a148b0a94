#include "hybrid/glossy/surface_radiance.h"

#include <algorithm>
#include <cmath>

#include "core/platform/shared_value.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/visibility/query_and_bake.h"

namespace fieldtrace {
namespace {

constexpr uint32_t k_patch_stream = 0x50544348u;
constexpr int k_most_divisions = 64;

// Storage of the n x n patches of a triangle. A lower patch (i, j) lies at row-major place (i, j); the upper one of the
// same square at the place mirrored about the square's middle. Those places are free: lower patches have i + j < n,
// upper ones i + j < n - 1.
size_t patch_place(int n, int i, int j, bool upper) {
  return upper ? size_t((n - 1 - i) * n + (n - 1 - j)) : size_t(i * n + j);
}

// A patch's texture is sampled at the centres of the k_texture_divisions^2 patches that it would be cut into.
constexpr int k_texture_divisions = 4;

struct PatchCentre {
  float u, v;
};
PatchCentre patch_centre(int n, size_t place) {
  const int i = int(place) / n, j = int(place) % n;
  const float step = 1.0f / float(n);
  if (i + j < n) return {(float(i) + 1.0f / 3.0f) * step, (float(j) + 1.0f / 3.0f) * step};
  return {(float(n - 1 - i) + 2.0f / 3.0f) * step, (float(n - 1 - j) + 2.0f / 3.0f) * step};
}

// n for a triangle, so that the edges of its patches are at most `patch` long in world space.
int divisions(const Affine& to_world, const TriangleMesh& mesh, const UVec3& t, float patch) {
  const auto edge = [&](uint32_t a, uint32_t b) {
    return glm::length(transform_vector(to_world, mesh.positions[a] - mesh.positions[b]));
  };
  const float longest = std::max({edge(t.x, t.y), edge(t.y, t.z), edge(t.z, t.x)});
  return std::clamp(int(std::ceil(std::min(longest / patch, float(k_most_divisions)))), 1, k_most_divisions);
}

// The k-th of the k_texture_divisions^2 texture points of the patch at that place.
PatchCentre texture_point(int n, size_t place, size_t k) {
  const PatchCentre within = patch_centre(k_texture_divisions, k);
  const int i = int(place) / n, j = int(place) % n;
  const float step = 1.0f / float(n);
  if (i + j < n) return {(float(i) + within.u) * step, (float(j) + within.v) * step};
  return {(float(n - i) - within.u) * step, (float(n - j) - within.v) * step};
}

}  // namespace

bool SurfaceRadiance::suits(const Scene& scene, uint32_t index) {
  const Instance& instance = scene.instances[index];
  if (instance.emitter != k_none || scene.shapes[instance.shape].kind != ShapeKind::mesh) return false;
  return is_diffuse_and_opaque(scene, instance.bsdf);
}

uint64_t SurfaceRadiance::count_patches(const Scene& scene, uint32_t index, float patch) {
  const Instance& instance = scene.instances[index];
  const TriangleMesh& mesh = scene.shapes[instance.shape].mesh;
  uint64_t count = 0;
  for (const UVec3& t : mesh.triangles) {
    const auto n = uint64_t(divisions(instance.to_world, mesh, t, patch));
    count += n * n;
  }
  return count;
}

SurfaceRadiance::SurfaceRadiance(const TransportContext& shading, uint32_t index, float patch)
    : scene_(shading.scene),
      seed_(shading.settings.seed),
      instance_(index),
      is_textured_(is_textured(shading.scene, shading.scene.instances[index].bsdf)),
      followers_([&shading] { return make_path_follower(shading); }) {
  const Instance& instance = scene_.instances[index];
  const TriangleMesh& mesh = scene_.shapes[instance.shape].mesh;
  first_.reserve(mesh.triangles.size() + 1);
  divisor_.reserve(mesh.triangles.size());
  uint64_t count = 0;
  for (const UVec3& t : mesh.triangles) {
    const int n = divisions(instance.to_world, mesh, t, patch);
    first_.push_back(uint32_t(count));
    divisor_.push_back(uint16_t(n));
    count += uint64_t(n) * uint64_t(n);
  }
  first_.push_back(uint32_t(count));
  radiance_.assign(2 * count, Rgb(0.0f));
  shaded_.assign(2 * count, 0);
}

SurfaceRadiance::PatchPlace SurfaceRadiance::place_of(Side side) const {
  const uint32_t patch = side / 2;
  const auto triangle = uint32_t(std::upper_bound(first_.begin(), first_.end(), patch) - first_.begin() - 1);
  return {triangle, divisor_[triangle], patch - first_[triangle]};
}

HitBatch SurfaceRadiance::centres_of(std::span<const Side> sides) const {
  HitBatch hits;
  hits.resize(sides.size());
  for (size_t i = 0; i < sides.size(); ++i) {
    const PatchPlace at = place_of(sides[i]);
    const PatchCentre centre = patch_centre(at.divisor, at.place);
    hits.instance[i] = instance_;
    hits.primitive[i] = at.triangle;
    hits.u[i] = centre.u, hits.v[i] = centre.v;
  }
  return hits;
}

// The mean of the texture over a patch: what a filter wider than the patch sees.
Rgb SurfaceRadiance::mean_reflectance(Side side, bool behind) const {
  constexpr size_t k_points = size_t(k_texture_divisions) * k_texture_divisions;
  const PatchPlace at = place_of(side);
  const Instance& instance = scene_.instances[instance_];
  Rgb sum(0.0f);
  for (size_t k = 0; k < k_points; ++k) {
    const PatchCentre point = texture_point(at.divisor, at.place, k);
    const Vec2 uv = triangle_uv(scene_.shapes[instance.shape], at.triangle, point.u, point.v);
    sum += resolve_material(scene_, instance.bsdf, uv, behind ? -1.0f : 1.0f).reflectance;
  }
  return sum / float(k_points);
}

// The vertex on `side` of the patch whose centre is `surface`; it refers to `material`, which this fills.
PathVertex SurfaceRadiance::vertex_at(Side side, const SurfacePoint& surface, Material& material) const {
  const bool back = side % 2 != 0;
  PathVertex v = patch_vertex(scene_, surface, back, material);
  if (is_textured_) material.reflectance = mean_reflectance(side, is_turned(surface, back));
  v.seed = scalar::vertex_seed(seed_, side, instance_, k_patch_stream);
  v.lobe_samples = float(k_patch_samples);
  return v;
}

uint64_t SurfaceRadiance::shade(std::span<const Side> sides) {
  std::vector<Side> missing;
  for (const Side side : sides) {
    if (!shared(shaded_[side]).load(std::memory_order_acquire)) missing.push_back(side);
  }
  sort_unique(missing);
  const HitBatch centres = centres_of(missing);
  std::vector<Side> lit;
  std::vector<PathVertex> vertices;
  std::vector<PathState> paths;
  // What the vertices refer to.
  std::vector<SurfacePoint> surfaces(missing.size());
  std::vector<Material> materials(missing.size());
  const RayBatch rays;  // surface_at() does not read the ray for meshes
  for (size_t i = 0; i < missing.size(); ++i) {
    surfaces[i] = surface_at(scene_, rays, centres, i);
    const PathVertex v = vertex_at(missing[i], surfaces[i], materials[i]);
    if (v.material->dark) {  // its radiance stays zero
      shared(shaded_[missing[i]]).store(1, std::memory_order_release);
      continue;
    }
    lit.push_back(missing[i]);
    vertices.push_back(v);
    // Further surfaces on the patch's paths draw their seeds from this virtual pixel.
    const uint32_t row = scalar::hash_combine(instance_, k_patch_stream);
    paths.emplace_back().pixel_seed = scalar::pixel_seed(seed_, missing[i], row);
  }
  if (lit.empty()) return 0;
  std::vector<Rgb> leaving(lit.size());
  const uint64_t traced = followers_.local()->follow(vertices, paths, leaving);
  for (size_t i = 0; i < lit.size(); ++i) {
    for (int c = 0; c < 3; ++c) shared(radiance_[lit[i]][c]).store(leaving[i][c], std::memory_order_relaxed);
    shared(shaded_[lit[i]]).store(1, std::memory_order_release);
  }
  return traced;
}

Rgb SurfaceRadiance::radiance(Side side) const {
  Rgb value;
  for (int c = 0; c < 3; ++c) value[c] = shared(radiance_[side][c]).load(std::memory_order_relaxed);
  return value;
}

SurfaceRadiance::Side SurfaceRadiance::side_at(uint32_t triangle, float u, float v, bool back) const {
  const int n = divisor_[triangle];
  const auto cell = [n](float x) { return std::clamp(int(x * float(n)), 0, n - 1); };
  int i = cell(u), j = cell(v);
  if (i + j > n - 1) j = n - 1 - i;  // rounding put it beyond the far edge
  const float fu = u * float(n) - float(i), fv = v * float(n) - float(j);
  const bool upper = fu + fv > 1.0f && i + j < n - 1;
  return 2 * (first_[triangle] + uint32_t(patch_place(n, i, j, upper))) + (back ? 1 : 0);
}

}  // namespace fieldtrace
