// What is baked for a picture does not depend on the order of queries. Whether a render fits its memory budget rests on
// that (docs/decisions/013-field-memory.md).
#include <gtest/gtest.h>

#include <numeric>

#include "core/light/light_sampling.h"
#include "tests/support/cone_scene.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr int k_light_samples = 256;
constexpr LightSampleRange k_parts = {16, 0, 16, 4};

// The order in which shading points are queried, and how many at once.
enum class Order { at_once, one_by_one, from_the_end };

struct Demand {
  uint64_t bytes = 0, cells = 0, tiles = 0;
  bool operator==(const Demand&) const = default;
};

std::ostream& operator<<(std::ostream& out, const Demand& d) {
  return out << d.bytes << " bytes, " << d.cells << " cells, " << d.tiles << " tiles";
}

ShadingPointBatch part_of(const ShadingPointBatch& all, const std::vector<uint32_t>& indices) {
  ShadingPointBatch part;
  part.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) {
    const size_t r = indices[i];
    set_shading_point(part, i, {all.px[r], all.py[r], all.pz[r]}, {all.gx[r], all.gy[r], all.gz[r]}, all.instance[r]);
    part.radius[i] = all.radius[r];
    part.seed[i] = all.seed[r];
  }
  return part;
}

// What an empty field of the scene's object holds after query(part) for all parts of the shading points, in that order.
template <class Query>
Demand demand_of(ConeScene& s, const ShadingPointBatch& shading_points, Order order, const Query& query) {
  s.field = std::make_unique<Field>(s.field->ball(), s.field->parameters());
  std::vector<uint32_t> indices(shading_points.size);
  std::iota(indices.begin(), indices.end(), 0u);
  if (order == Order::from_the_end) std::reverse(indices.begin(), indices.end());
  if (order == Order::at_once) {
    query(part_of(shading_points, indices));
  } else {
    for (const uint32_t r : indices) query(part_of(shading_points, {r}));
  }
  return {s.field->bytes(), s.field->cells_baked(), s.field->coverage().tiles_baked()};
}

template <class Query>
Demand expect_one_demand(ConeScene& s, const ShadingPointBatch& shading_points, const Query& query) {
  const Demand demand = demand_of(s, shading_points, Order::at_once, query);
  EXPECT_EQ(demand_of(s, shading_points, Order::one_by_one, query), demand);
  EXPECT_EQ(demand_of(s, shading_points, Order::from_the_end, query), demand);
  return demand;
}

ConeScene random_scene(const TriangleMesh& mesh, TestRandom& random) {
  const Affine place = random_place(random, 1.0f, 2.0f);
  const float distance = random.uniform(3.0f, 6.0f);
  return ConeScene(mesh, place,
                   {Vec3(place[3]) + distance * random.direction(), distance * random.uniform(0.05f, 0.3f)});
}

// From a surface, directions over the light are tried one after another: those that an earlier one makes needless must
// not be baked.
TEST(FieldDemand, OfWholeLightsFromASurfaceDoesNotDependOnTheOrder) {
  TestRandom random(31);
  uint64_t cells = 0;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 6; ++i) {
      ConeScene s = random_scene(mesh, random);
      const ShadingPointBatch shading_points = self_shading_points(s, 48, random);
      cells += expect_one_demand(s, shading_points, [&](const ShadingPointBatch& part) {
                 Stats stats;
                 s.find(s.answerer(Isa::automatic, 0.1f), part, k_light_samples, stats);
               }).cells;
    }
  }
  EXPECT_GT(cells, 20000u);  // many cells were demanded
}

TEST(FieldDemand, OfPartsOfLightsDoesNotDependOnTheOrder) {
  TestRandom random(32);
  uint64_t tiles = 0;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 6; ++i) {
      ConeScene s = random_scene(mesh, random);
      const LightTable lights = make_lights(s.maker.scene);
      ShadingPointBatch shading_points = shadowed_shading_points(s, world_ball(s), 64, random);
      for (size_t r = 0; r < shading_points.size; ++r) shading_points.seed[r] = uint32_t(r + 1) * 2654435761u;
      tiles += expect_one_demand(s, shading_points, [&](const ShadingPointBatch& part) {
                 Stats stats;
                 const ShadowAnswerer answerer = s.answerer(Isa::automatic, 0.1f);
                 const ShadowGroup group = s.find(answerer, part, k_light_samples, stats);
                 std::vector<uint32_t> open;
                 for (uint32_t r = 0; r < part.size; ++r) {
                   if (group.shadow[r] == k_may_shadow && !group.by_rays[r]) open.push_back(r);
                 }
                 ShadowBatch batch;
                 std::vector<uint8_t> undecided;
                 sample_light(lights, 0, part_of(part, open), k_parts, resolve_isa(Isa::automatic), batch);
                 answerer.filter({group, part, open, k_parts.count, batch, undecided, stats});
               }).tiles;
    }
  }
  EXPECT_GT(tiles, 500u);
}

}  // namespace
}  // namespace fieldtrace
