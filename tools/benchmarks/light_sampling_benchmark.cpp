// Time per shadow ray of sample_light: kind of light x samples per shading point x instruction set; and per point of
// the closed forms of whole lights.
//
// Run: light_sampling_benchmark --benchmark_repetitions=9 --benchmark_report_aggregates_only=true
// and read the medians; items_per_second counts rays or points.

#include <benchmark/benchmark.h>

#include <random>
#include <string>

#include "core/light/light_irradiance.h"
#include "core/light/light_sampling.h"
#include "core/sampling/sobol.hd.h"

namespace {

using namespace fieldtrace;

Scene one_light_scene(ShapeKind kind) {
  Scene scene;
  Shape shape;
  shape.kind = kind;
  scene.shapes.push_back(shape);
  Instance instance;
  instance.to_world = Affine(0.3f, 0, 0, 0, 0.3f, 0, 0, 0, 0.3f, 0, 0, 4);
  instance.flip_normals = kind != ShapeKind::sphere;  // planar shapes emit downwards
  scene.instances.push_back(instance);
  Emitter emitter;
  emitter.instance = 0;
  scene.emitters.push_back(emitter);
  return scene;
}

Scene scene_of(const std::string& name) {
  if (name == "sphere") return one_light_scene(ShapeKind::sphere);
  if (name == "rectangle") return one_light_scene(ShapeKind::rectangle);
  if (name == "disk") return one_light_scene(ShapeKind::disk);
  Scene scene;
  Emitter emitter;
  emitter.kind = name == "point" ? EmitterKind::point : EmitterKind::constant;
  emitter.position = Vec3(0, 0, 4);
  scene.emitters.push_back(emitter);
  return scene;
}

ShadingPointBatch floor_shading_points(size_t count) {
  ShadingPointBatch r;
  r.resize(count);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> position(-2.0f, 2.0f);
  for (size_t i = 0; i < count; ++i) {
    r.px[i] = position(random), r.py[i] = position(random), r.pz[i] = 0.0f;
    r.gx[i] = r.gy[i] = r.sx[i] = r.sy[i] = 0.0f;
    r.gz[i] = r.sz[i] = 1.0f;
    r.error[i] = 1e-6f;
    r.seed[i] = scalar::hash_uint(uint32_t(i) + 1);
    r.sample[i] = uint32_t(i % 16);
    r.instance[i] = 0;
    r.transmits[i] = 0;
  }
  return r;
}

void sample(benchmark::State& state, const std::string& name, int light_samples, Isa isa) {
  constexpr size_t k_slots = 1024;  // about the first-level cache, like one stage of a tile
  const Scene scene = scene_of(name);
  const LightTable lights = make_lights(scene);
  const ShadingPointBatch shading_points = floor_shading_points(k_slots / size_t(light_samples));
  ShadowBatch out;
  for (auto _ : state) {
    sample_light(lights, 0, shading_points, light_samples, isa, out);
    benchmark::DoNotOptimize(out.weight.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(int64_t(state.iterations()) * int64_t(out.rays.size));
}

// `vectors`: irradiance_vectors() instead of whole_irradiance().
template <bool vectors>
void irradiance(benchmark::State& state, const std::string& name, Isa isa) {
  const LightTable lights = make_lights(scene_of(name));
  const ShadingPointBatch points = floor_shading_points(1024);
  IrradianceVectors out;
  for (auto _ : state) {
    if constexpr (vectors) irradiance_vectors(lights.lights[0], points, isa, out);
    if constexpr (!vectors) whole_irradiance(lights.lights[0], points, isa, out.x);
    benchmark::DoNotOptimize(out.x.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(int64_t(state.iterations()) * int64_t(points.size));
}

}  // namespace

int main(int argc, char** argv) {
  for (const char* name : {"sphere", "rectangle", "disk", "point", "constant"}) {
    for (int light_samples : {1, 4, 64}) {
      for (Isa isa : supported_isas()) {
        const std::string title =
            "sample_light." + std::string(name) + ".M" + std::to_string(light_samples) + "." + isa_name(isa);
        benchmark::RegisterBenchmark(title.c_str(), [=](benchmark::State& s) { sample(s, name, light_samples, isa); });
      }
    }
  }
  for (const std::string name : {"sphere", "rectangle", "disk"}) {
    for (Isa isa : supported_isas()) {
      const std::string title = "." + name + "." + isa_name(isa);
      benchmark::RegisterBenchmark(("irradiance_vectors" + title).c_str(),
                                   [=](benchmark::State& s) { irradiance<true>(s, name, isa); });
      if (name == "disk") continue;  // has no whole_irradiance()
      benchmark::RegisterBenchmark(("whole_irradiance" + title).c_str(),
                                   [=](benchmark::State& s) { irradiance<false>(s, name, isa); });
    }
  }
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
