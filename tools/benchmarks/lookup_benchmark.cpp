// Field look-ups against Embree's occlusion rays, per core, over the same rays: all cross the object's ball.
//
// Arguments: MESH.obj|MESH.ply (default: the bunny of Debian's glmark2-data). Rays run from points outside the ball,
// and from points on the object itself, towards a sphere light of 4 degrees; the field is baked beforehand. Embree
// traces the same rays in each of its packet forms; the fastest is the baseline. Rates are per second of this thread's
// processor time.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <random>
#include <string>

#include "core/mesh/mesh_io.h"
#include "core/trace/accel.h"
#include "field/bake/bake.h"
#include "field/query/query.hd.h"
#include "field/query/segment_kernels.h"
#include "field/store/risk_classes.h"
#include "tools/benchmarks/embree_occlusion.h"

namespace fieldtrace {
namespace {

// The renderer's batch size, which fits the second-level cache.
constexpr size_t k_rays = 1 << 13;

struct Setup {
  Scene scene;
  std::unique_ptr<Accel> accel;  // for the bake
  std::unique_ptr<EmbreeOcclusion> embree;
  std::unique_ptr<Field> field;
  SegmentTask task;

  explicit Setup(const char* path) {
    Shape shape;
    MeshLoadOptions options;
    shape.mesh = load_mesh(path, options, {});
    shape.bounds = shape.mesh.bounds();
    scene.shapes.push_back(std::move(shape));
    scene.instances.emplace_back();
    accel = std::make_unique<Accel>(scene);
    embree = std::make_unique<EmbreeOcclusion>(scene.shapes[0].mesh);
    const Sphere ball = field_ball(scene.shapes[0].bounds);
    field = std::make_unique<Field>(ball, FieldParameters{});
    task.field = field->view();
    task.policy = query_policy(0.1f);
    const float s = 1.0f / ball.radius;
    const float m[12] = {s, 0, 0, 0, s, 0, 0, 0, s, -ball.centre.x * s, -ball.centre.y * s, -ball.centre.z * s};
    std::copy(m, m + 12, task.to_unit);
  }

  // 64 rays from each shading point towards a sphere light 4.6 radii away; shading points lie on a plane beside the
  // ball or on the mesh. Only rays that cross the ball are kept.
  RayBatch make_rays(bool self) const {
    std::mt19937 generator(7);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    const Sphere ball = field->ball();
    const TriangleMesh& mesh = scene.shapes[0].mesh;
    const Vec3 to_light = glm::normalize(Vec3(0.5f, 0.8f, 0.3f));
    RayBatch rays;
    rays.resize(k_rays);
    size_t n = 0;
    const auto inside = [&](const Vec3& o, const Vec3& d) {
      const Vec3 c = ball.centre - o;
      const Vec3 gap = c - d * (glm::dot(c, d) / glm::dot(d, d));
      return glm::dot(gap, gap) < ball.radius * ball.radius;
    };
    while (n < k_rays) {
      Vec3 p, normal(0.0f);
      if (self) {
        const UVec3 t = mesh.triangles[size_t(uniform(generator) * float(mesh.triangles.size() - 1))];
        p = (mesh.positions[t.x] + mesh.positions[t.y] + mesh.positions[t.z]) / 3.0f;
        normal = glm::normalize(
            glm::cross(mesh.positions[t.y] - mesh.positions[t.x], mesh.positions[t.z] - mesh.positions[t.x]));
        if (glm::dot(normal, to_light) < 0.0f) continue;
        p += normal * (1e-5f * ball.radius);
      } else {
        p = ball.centre - to_light * (2.0f * ball.radius) +
            Vec3(2.0f * uniform(generator) - 1.0f, 0.0f, 2.0f * uniform(generator) - 1.0f) * (1.5f * ball.radius);
      }
      for (int k = 0; k < 64 && n < k_rays; ++k) {
        const Vec3 q = 2.0f * Vec3(uniform(generator), uniform(generator), uniform(generator)) - 1.0f;
        const Vec3 d = ball.centre + ball.radius * (4.6f * to_light + 0.16f * q) - p;
        if (inside(p, d)) rays.set(n++, p, d, 1.0f);
      }
    }
    return rays;
  }

  void bake(const RayBatch& rays, const std::vector<uint32_t>& instances) {
    RayStates states;
    for (int round = 0; round < 6; ++round) {
      states.reset(rays.size);
      segment_kernels(Isa::scalar).query(task, rays, instances.data(), 0, rays.size, 0, states);
      BakeCounters counters;
      bake_slices(*field, FieldLayer::visibility, states.unknown_visibility, *accel, 0, counters);
      bake_slices(*field, FieldLayer::depth, states.unknown_depth, *accel, 0, counters);
      if (states.unknown_blocks.empty()) break;
      states.unknown_blocks.clear();
      states.unknown_visibility.clear();
      states.unknown_depth.clear();
    }
  }
};

void run_lookups(benchmark::State& state, Setup& setup, bool self, Isa isa) {
  const RayBatch rays = setup.make_rays(self);
  const AlignedVector<uint32_t> instances(padded(rays.size), self ? 0u : 1u);
  setup.bake(rays, {instances.begin(), instances.end()});
  RayStates states;
  uint64_t lookups = 0;
  // Batches of 8192 rays, as in the renderer.
  for (auto _ : state) {
    states.reset(rays.size);
    for (size_t begin = 0; begin < rays.size; begin += 8192) {
      lookups += segment_kernels(isa)
                     .query(setup.task, rays, instances.data(), begin, std::min(begin + 8192, rays.size), 0, states)
                     .lookups;
    }
  }
  size_t undecided = 0;
  for (const int32_t s : states.state) undecided += s >= RayStates::k_undecided;
  state.counters["rays/s"] =
      benchmark::Counter(double(rays.size) * double(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["look-ups/ray"] = double(lookups) / double(state.iterations()) / double(rays.size);
  state.counters["undecided"] = double(undecided) / double(rays.size);
}

void run_rays(benchmark::State& state, Setup& setup, bool self, OcclusionPackets packets) {
  const RayBatch rays = setup.make_rays(self);
  size_t blocked = 0;
  for (auto _ : state) blocked = setup.embree->count_blocked(rays, packets);
  state.counters["rays/s"] =
      benchmark::Counter(double(rays.size) * double(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["blocked"] = double(blocked) / double(rays.size);
}

}  // namespace
}  // namespace fieldtrace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  using namespace fieldtrace;
  if (argc > 2 || (argc == 2 && argv[1][0] == '-')) {
    std::fprintf(stderr, "lookup_benchmark: %s is not known; arguments: [MESH.obj|MESH.ply] [--benchmark_...]\n",
                 argv[argc - 1]);
    return 2;
  }
  std::unique_ptr<Setup> setup;
  try {
    setup = std::make_unique<Setup>(argc > 1 ? argv[1] : "/usr/share/glmark2/models/bunny.obj");
  } catch (const std::exception& e) {
    std::fprintf(stderr, "lookup_benchmark: %s\n", e.what());
    return 1;
  }
  benchmark::AddCustomContext("triangles", std::to_string(setup->scene.shapes[0].triangle_count()));
  for (const bool self : {false, true}) {
    const std::string shading_point = self ? "own_surface" : "elsewhere";
    for (const Isa isa : supported_isas()) {
      benchmark::RegisterBenchmark(("LookUp." + shading_point + "." + isa_name(isa)).c_str(),
                                   [&setup, self, isa](benchmark::State& s) { run_lookups(s, *setup, self, isa); });
    }
    for (const OcclusionPackets packets : {OcclusionPackets::single, OcclusionPackets::eight_incoherent,
                                           OcclusionPackets::sixteen_coherent, OcclusionPackets::sixteen_incoherent}) {
      benchmark::RegisterBenchmark(
          ("EmbreeOccluded." + shading_point + "." + packets_name(packets)).c_str(),
          [&setup, self, packets](benchmark::State& s) { run_rays(s, *setup, self, packets); });
    }
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
