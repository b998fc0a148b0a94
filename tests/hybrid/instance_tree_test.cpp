// The tree of bounds against testing every instance: the same sets, over scenes of all sizes.

#include "hybrid/culling/instance_tree.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// `count` boxes from degenerate ones (points, lines, plates) to boxes far larger than the cloud of their centres.
Scene random_scene(TestRandom& random, size_t count, float unit, float smallest, float largest) {
  SceneMaker maker;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  const uint32_t shapes[] = {maker.shape(ShapeKind::sphere), maker.shape(ShapeKind::rectangle)};
  Shape point;
  point.bounds = {Vec3(0.0f), Vec3(0.0f)};
  maker.scene.shapes.push_back(point);
  for (size_t i = 0; i < count; ++i) {
    Affine a = test::scaling(Vec3(unit * random.log_uniform(smallest, largest)));
    // Many share a centre, so that the median must separate equal keys.
    if (random.uniform() < 0.9f) a[3] = random.in_ball() * unit;
    const uint32_t shape = random.index(8) == 0 ? 2 : shapes[random.index(2)];
    Instance instance;
    instance.shape = shape;
    instance.bsdf = grey;
    instance.to_world = a;
    maker.scene.instances.push_back(instance);
  }
  return maker.scene;
}

LightExtent random_light(TestRandom& random, float unit, uint32_t instances) {
  LightExtent light;
  const uint32_t kind = random.index(5);
  if (kind == 0) {
    light.kind = LightExtent::Kind::everywhere;
  } else if (kind == 1) {
    light.kind = LightExtent::Kind::directional;
    light.towards = random.direction();
  } else {
    const float radius = kind == 2 ? 0.0f : unit * random.log_uniform(1e-3f, 2.0f);
    light.ball = {random.in_ball() * (2.0f * unit), radius};
    light.bounds = {light.ball.centre - Vec3(radius), light.ball.centre + Vec3(radius)};
    if (random.uniform() < 0.5f) light.instance = random.index(instances);
  }
  return light;
}

Bounds3 random_shading_points(TestRandom& random, float unit) {
  Bounds3 b;
  b.extend(random.in_ball() * unit);
  if (random.uniform() < 0.7f) b.extend(b.lower + random.in_ball() * unit * random.log_uniform(1e-4f, 1.0f));
  return b;
}

std::vector<uint32_t> query_each(const InstanceTree& tree, const Shaft& shaft, uint32_t left_out, size_t count) {
  std::vector<uint32_t> all;
  for (uint32_t i = 0; i < count; ++i) {
    if (i != left_out && shaft.meets(tree.bounds(i))) all.push_back(i);
  }
  return all;
}

void compare_sets(uint32_t seed, size_t count, int queries, float unit, float smallest, float largest) {
  TestRandom random(seed);
  const Scene scene = random_scene(random, count, unit, smallest, largest);
  const InstanceTree tree(scene);
  size_t found = 0, left = 0;
  std::vector<uint32_t> instances;
  for (int i = 0; i < queries; ++i) {
    const LightExtent light = random_light(random, unit, uint32_t(count));
    const Shaft shaft(random_shading_points(random, unit), light);
    const std::vector<uint32_t> expected = query_each(tree, shaft, light.instance, count);
    tree.find(shaft, light.instance, count, instances);
    ASSERT_EQ(instances, expected) << "seed " << seed << ", query " << i;
    found += instances.size();
    left += count - instances.size();
    const size_t limit = random.index(uint32_t(count));
    tree.find(shaft, light.instance, limit, instances);
    ASSERT_EQ(instances.size(), std::min(limit + 1, expected.size()));
    ASSERT_TRUE(std::ranges::includes(expected, instances));
  }
  EXPECT_GT(found, 0u);
  EXPECT_GT(left, 0u);
}

TEST(InstanceTree, FindsWhatAskingEachFinds) {
  uint32_t seed = 1;
  for (const float unit : {1e-6f, 1.0f, 1e6f}) {
    for (const size_t count : {1, 2, 3, 5, 33, 1000}) {
      compare_sets(seed++, count, 300, unit, 1e-3f, 0.1f);
      compare_sets(seed++, count, 300, unit, 1e-8f, 10.0f);
    }
  }
}

TEST(InstanceTree, FindsWhatAskingEachFindsInACrowd) {
  compare_sets(101, 10000, 200, 1.0f, 1e-3f, 1e-2f);
  compare_sets(102, 10000, 50, 1.0f, 1e-6f, 1.0f);
}

// Bounds near and beyond the largest float, whose squares overflow.
TEST(InstanceTree, HugeBoundsAreFound) {
  compare_sets(201, 500, 200, 1e30f, 1e-3f, 1.0f);
  TestRandom random(7);
  Scene scene = random_scene(random, 100, 1.0f, 1e-3f, 1e-2f);
  scene.instances[42].shape = 0;  // a sphere
  scene.instances[42].to_world = test::scaling(Vec3(3.4e38f));
  scene.instances[42].to_world[3] = Vec3(3.4e38f);
  const InstanceTree tree(scene);
  std::vector<uint32_t> instances;
  for (int i = 0; i < 100; ++i) {
    const LightExtent light = random_light(random, 1.0f, 1);
    tree.find(Shaft(random_shading_points(random, 1.0f), light), k_none, 100, instances);
    EXPECT_TRUE(std::ranges::find(instances, 42u) != instances.end());
  }
}

TEST(InstanceTree, EmptySceneHasNoCandidates) {
  std::vector<uint32_t> instances = {1};
  LightExtent light;
  light.kind = LightExtent::Kind::everywhere;
  InstanceTree(Scene()).find(Shaft({Vec3(0), Vec3(1)}, light), k_none, 5, instances);
  EXPECT_TRUE(instances.empty());
}

// A ball that touches a ray between the hull's two balls meets the shaft; one just clear of the hull does not.
TEST(Shaft, IsTheHullOfTwoBalls) {
  TestRandom random(11);
  size_t met = 0, missed = 0;
  for (int i = 0; i < 20000; ++i) {
    const float unit = random.log_uniform(1e-6f, 1e6f);
    const Bounds3 shading_points = random_shading_points(random, unit);
    LightExtent light = random_light(random, unit, 1);
    if (light.kind != LightExtent::Kind::bounded) continue;
    const DVec3 a(0.5 * (DVec3(shading_points.lower) + DVec3(shading_points.upper))), b(light.ball.centre);
    const double ra = 0.5 * glm::length(DVec3(shading_points.upper) - DVec3(shading_points.lower)),
                 rb = light.ball.radius;
    BallAndBox object;
    object.centre = DVec3(random.in_ball()) * double(unit);
    object.box = {Vec3(-k_infinity), Vec3(k_infinity)};
    // By brute force: the gap to the nearest ball of the hull.
    double gap = 1e300;
    for (int k = 0; k <= 2000; ++k) {
      const double t = k / 2000.0;
      gap = std::min(gap, glm::length(object.centre - (a + (b - a) * t)) - (ra + (rb - ra) * t));
    }
    if (gap <= 0.0) continue;
    const Shaft shaft(shading_points, light);
    object.radius = gap;
    ASSERT_TRUE(shaft.meets(object)) << i;
    ++met;
    // Where one ball nearly hides the other, a cylinder replaces the cone.
    if (std::abs(rb - ra) > 0.98 * glm::length(b - a)) continue;
    // The brute force overestimates the gap by (length / 4000)^2 / gap, and by length / 4000 at most.
    object.radius = gap - glm::length(b - a) / 2000.0;
    if (object.radius <= 0.0) continue;
    ASSERT_FALSE(shaft.meets(object)) << i;
    ++missed;
  }
  EXPECT_GT(met, 1000u);
  EXPECT_GT(missed, 1000u);
}

// Every instruction set gives what Shaft says of each point by itself, bit for bit.
TEST(Shaft, ManyPointsAtOnceAreAsEachAlone) {
  TestRandom random(12);
  size_t met = 0, missed = 0;
  for (int i = 0; i < 400; ++i) {
    const float unit = random.log_uniform(1e-6f, 1e6f);
    LightExtent light = random_light(random, unit, 1);
    if (light.kind != LightExtent::Kind::bounded) continue;
    BallAndBox object;
    object.centre = DVec3(random.in_ball()) * double(unit);
    object.radius = random.index(8) == 0 ? 0.0 : double(unit * random.log_uniform(1e-3f, 1.0f));
    const bool is_unbounded = random.index(8) == 0;
    const Vec3 reach(is_unbounded ? k_infinity : float(object.radius) * random.uniform(0.6f, 1.0f));
    object.box = {Vec3(object.centre) - reach, Vec3(object.centre) + reach};
    if (is_unbounded && random.uniform() < 0.5f) object.radius = double(k_infinity);
    ShadingPointBatch points;
    points.resize(1 + random.index(100));
    for (size_t r = 0; r < points.size; ++r) {
      // Some lie in the light's centre, where the axis has no direction.
      const Vec3 p = random.index(16) == 0 ? light.ball.centre : random.in_ball() * (2.0f * unit);
      points.px[r] = p.x, points.py[r] = p.y, points.pz[r] = p.z;
      points.error[r] = random.index(4) == 0 ? 0.0f : unit * random.log_uniform(1e-9f, 1e-3f);
      points.radius[r] = random.index(2) == 0 ? 0.0f : unit * random.log_uniform(1e-3f, 1.0f);
    }
    AlignedVector<int32_t> asked(padded(points.size), 0);
    for (size_t r = 0; r < points.size; ++r) asked[r] = random.index(4) == 0 ? 0 : 1 + int32_t(random.index(3));
    for (const Isa isa : supported_isas()) {
      AlignedVector<int32_t> flags = asked;
      shaft_kernel(isa)(shaft_task(light, object), points, flags.data());
      for (size_t r = 0; r < points.size; ++r) {
        const Vec3 p = points.position(r), apart(points.error[r] + points.radius[r]);
        const bool meets = Shaft({p - apart, p + apart}, light).meets(object);
        ASSERT_EQ(flags[r], meets ? asked[r] : 0) << i << " " << r << " " << isa_name(isa);
        (meets ? met : missed) += asked[r] != 0;
      }
    }
  }
  EXPECT_GT(met, 1000u);
  EXPECT_GT(missed, 1000u);
}

}  // namespace
}  // namespace fieldtrace
