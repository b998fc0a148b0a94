#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/isa.h"
#include "core/trace/accel.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

class Random {
 public:
  explicit Random(uint32_t seed) : engine_(seed) {}
  double between(double a, double b) { return a + (b - a) * std::uniform_real_distribution<double>()(engine_); }
  double size(double low, double high) { return std::exp(between(std::log(low), std::log(high))); }
  DVec3 direction() {
    for (;;) {
      const DVec3 v(between(-1, 1), between(-1, 1), between(-1, 1));
      const double l = glm::length(v);
      if (l > 0.1 && l < 1.0) return v / l;
    }
  }
  int below(int n) { return int(between(0, n)); }

 private:
  std::mt19937 engine_;
};

// A random rotation and shear, with axes whose lengths differ by up to `stretch`.
Affine random_placement(Random& random, double size, double stretch, const DVec3& centre) {
  const DVec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
  DAffine a;
  a[0] = x * size * random.size(1.0 / stretch, 1.0);
  a[1] = y * size * random.size(1.0 / stretch, 1.0);
  a[2] = (z + x * random.between(-0.5, 0.5)) * size * random.size(1.0 / stretch, 1.0);
  a[3] = centre;
  return Affine(a);
}

DVec3 apply(const Affine& a, const DVec3& p) {
  return DVec3(a[0]) * p.x + DVec3(a[1]) * p.y + DVec3(a[2]) * p.z + DVec3(a[3]);
}

ShadingPointBatch shading_points_at(const std::vector<DVec3>& points, float relative_error) {
  ShadingPointBatch r;
  r.resize(points.size());
  for (size_t i = 0; i < padded(points.size()); ++i) {
    const Vec3 p(points[std::min(i, points.size() - 1)]);
    r.px[i] = p.x, r.py[i] = p.y, r.pz[i] = p.z;
    r.error[i] = relative_error * (std::abs(p.x) + std::abs(p.y) + std::abs(p.z));
    r.instance[i] = k_none;
  }
  return r;
}

// A shading point whose ray to a point of the light crosses the occluder well inside must have it as a candidate.
// Groups of one shading point, so that the bounds themselves are tight.
void check_group(const Scene& scene, uint32_t emitter, uint32_t occluder, const std::vector<DVec3>& points,
                 const std::string& what) {
  const Accel accel(scene);
  const ShadowAnswerer answerer(scene, accel, shape_traits(scene), std::vector<Field*>(scene.shapes.size(), nullptr),
                                {.isa = resolve_isa(Isa::automatic), .tolerance = 0.0f});
  ShadowGroup group;
  group.light = light_extent(scene, emitter);
  group.light_samples.assign(points.size(), 1);
  group.pixel_samples = k_fewest_cone_samples;
  const ShadingPointBatch batch = shading_points_at(points, gamma_bound(3));
  Stats stats;
  answerer.find_candidates({batch, group, stats});
  const bool found = std::find(group.candidates.begin(), group.candidates.end(), occluder) != group.candidates.end();
  ASSERT_TRUE(found) << what;
  for (size_t r = 0; r < batch.size; ++r)
    ASSERT_TRUE(group.shadow[r] == k_may_shadow) << what << ", shading point " << r;
}

TEST(CullingBounds, DirectionalLightFindsOccludersFarFromTheOrigin) {
  Random random(1);
  for (int i = 0; i < 300; ++i) {
    SceneMaker m;
    const double radius = random.size(1e-6, 1e6);
    const DVec3 centre = random.direction() * radius * random.size(1.0, 1e3);
    const uint32_t shape = m.mesh(make_sphere({.around = 32, .along = 16}));
    const Affine place = random_placement(random, radius, 3.0, centre);
    const uint32_t occluder = m.instance(shape, m.bsdf(BsdfKind::diffuse, Rgb(0.5f)), place);
    const Vec3 towards = Vec3(random.direction());
    m.light(EmitterKind::directional, Rgb(1.0f), -towards);
    const DVec3 q = apply(place, random.direction() * 0.95);
    const DVec3 p = q - DVec3(towards) * radius * random.size(1.0, 100.0);
    check_group(m.scene, 0, occluder, {p},
                "directional, radius " + std::to_string(radius) + ", distance " + std::to_string(glm::length(centre)));
  }
}

TEST(CullingBounds, BoundedLightsFindOccludersOfAllSizes) {
  Random random(2);
  for (int i = 0; i < 3000; ++i) {
    SceneMaker m;
    const double unit = random.size(1e-6, 1e6);
    const double radius = unit * random.size(1e-3, 1.0), light_radius = unit * random.size(1e-3, 1.0);
    const uint32_t bsdf = m.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    const bool ball = random.below(2) == 0;
    const uint32_t shape = m.mesh(ball ? make_sphere({.around = 32, .along = 16}) : make_cube({.half_size = 1.0f}));
    const Affine place = random_placement(random, radius, 20.0, random.direction() * unit);
    const uint32_t occluder = m.instance(shape, bsdf, place);
    const DVec3 in_shape =
        ball ? random.direction() * 0.98 : DVec3(random.between(-0.99, 0.99), random.between(-0.99, 0.99), 0.99);
    const DVec3 q = apply(place, in_shape);
    const DVec3 light_centre = q + random.direction() * (radius + light_radius) * random.size(2.0, 300.0);
    const int kind = random.below(5);
    const Affine light_place = random_placement(random, light_radius, 5.0, light_centre);
    DVec3 l = light_centre;
    uint32_t emitter = 0;
    const DVec3 d = random.direction();
    if (kind == 0) {
      m.light(EmitterKind::point, Rgb(1.0f), Vec3(light_centre));
    } else {
      const ShapeKind kinds[] = {ShapeKind::sphere, ShapeKind::rectangle, ShapeKind::disk, ShapeKind::cylinder};
      const bool mesh_light = kind == 1 && random.below(2) == 0;
      const uint32_t light_shape =
          mesh_light ? m.mesh(make_sphere({.around = 32, .along = 16})) : m.shape(kinds[kind - 1]);
      m.area_light(m.instance(light_shape, bsdf, light_place), Rgb(1.0f));
      const double angle = random.between(0.0, 6.28);
      const DVec3 on_light[] = {d, DVec3(random.between(-1, 1), 1.0, 0.0), DVec3(std::cos(angle), std::sin(angle), 0.0),
                                DVec3(std::cos(angle), std::sin(angle), random.between(0, 1))};
      l = apply(light_place, on_light[kind - 1] * (mesh_light ? 0.98 : 1.0));
    }
    const DVec3 p = q + (q - l) * random.size(1e-3, 1e3);
    check_group(m.scene, emitter, occluder, {p},
                "kind " + std::to_string(kind) + ", unit " + std::to_string(unit) + ", radius " +
                    std::to_string(radius / unit) + ", shading point " + std::to_string(glm::length(p - q) / unit) +
                    (ball ? ", ball" : ", box"));
  }
}

// Occluders that are tiny against the distances on both sides, so that rounding of the coordinates matters.
TEST(CullingBounds, PointLightsFindTinyOccluders) {
  Random random(3);
  int checked = 0;
  for (int i = 0; i < 3000; ++i) {
    SceneMaker m;
    const double radius = random.size(1e-3, 1e3);
    const Affine place = random_placement(random, radius, 2.0, random.direction() * radius * random.size(1.0, 1e5));
    const uint32_t shape = m.mesh(make_cube({.half_size = 1.0f}));
    const uint32_t occluder = m.instance(shape, m.bsdf(BsdfKind::diffuse, Rgb(0.5f)), place);
    const DVec3 q = apply(place, random.direction() * random.between(0.0, 0.8));
    const DVec3 l = DVec3(Vec3(q + random.direction() * radius * random.size(2.0, 1e6)));
    m.light(EmitterKind::point, Rgb(1.0f), Vec3(l));
    const DVec3 p = q + (q - l) / glm::length(q - l) * radius * random.size(2.0, 1e6);
    // After rounding, the ray must still cross the occluder, with half its size as margin.
    const DVec3 rounded = DVec3(Vec3(p)), along = glm::normalize(l - rounded);
    const DVec3 gap = DVec3(place[3]) - rounded;
    if (glm::length(gap - along * glm::dot(gap, along)) > 0.45 * radius) continue;
    ++checked;
    check_group(m.scene, 0, occluder, {p},
                "radius " + std::to_string(radius) + ", light " + std::to_string(glm::length(l - q) / radius) +
                    ", shading point " + std::to_string(glm::length(p - q) / radius) + ", at " +
                    std::to_string(glm::length(DVec3(place[3])) / radius));
  }
  EXPECT_GT(checked, 1000);
}

}  // namespace
}  // namespace fieldtrace
