// Upper bound on the gain of any shadow answerer: a frame in which every shadow ray is clear at no cost.
//
// Arguments: SCENE.xml SPP LIGHT_SAMPLES THREADS [name=value ...]. Prints times as in `fieldtrace render --stats`, as
// JSON: build, primary, secondary, total (the frame alone, without loading or writing), seconds.
//
// Light transport gets an answerer for a scene without objects. It finds no candidates, so every shading point is
// unoccluded: light samples are drawn, weighted and summed, which counts as shading, and no ray is traced.
// time.secondary retains only the candidate queries. Tiles and batches are those of render().
#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <cstdlib>
#include <thread>

#include "core/loader/scene_xml.h"
#include "core/platform/error.h"
#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "hybrid/transport/trace_pixels.h"

namespace fieldtrace {
namespace {

struct Arguments {
  std::string scene;
  int spp = 1, light_samples = 1, threads = 1;
  SceneLoadOptions load;
};

int positive(const char* name, const char* text) {
  char* end = nullptr;
  const long value = std::strtol(text, &end, 10);
  if (*end != '\0' || value < 1 || value > 1 << 20) {
    throw UsageError(fmt::format("{} is {}; it must be a whole number from 1 to {}", name, text, 1 << 20));
  }
  return int(value);
}

Arguments parse(int argc, char** argv) {
  if (argc < 5) throw UsageError("use: free_visibility SCENE.xml SPP LIGHT_SAMPLES THREADS [name=value ...]");
  Arguments a{argv[1], positive("SPP", argv[2]), positive("LIGHT_SAMPLES", argv[3]), positive("THREADS", argv[4]), {}};
  for (int i = 5; i < argc; ++i) {
    const std::string definition = argv[i];
    const size_t equals = definition.find('=');
    if (equals == std::string::npos) throw UsageError(definition + ": write name=value");
    a.load.parameters[definition.substr(0, equals)] = definition.substr(equals + 1);
  }
  return a;
}

void run(const Arguments& arguments) {
  const Scene scene = load_scene(arguments.scene, arguments.load);
  Stats stats;
  tbb::task_arena arena(arguments.threads);
  arena.execute([&] {
    const ScopedTimer timer(stats.time_total);
    std::unique_ptr<Accel> accel;
    {
      const ScopedTimer build_timer(stats.time_build);
      accel = std::make_unique<Accel>(scene);
    }
    const CameraSampler camera(scene.camera, scene.film);
    TransportSettings settings;
    settings.light_samples = arguments.light_samples;
    settings.max_depth = scene.integrator.max_depth;
    settings.rr_depth = scene.integrator.rr_depth;
    settings.hide_emitters = scene.integrator.hide_emitters;
    settings.isa = resolve_isa(Isa::automatic);
    const Scene nothing;
    const ShadowAnswerer answerer(nothing, *accel, {}, {}, AnswererSettings{.isa = settings.isa});
    const TransportContext context(scene, *accel, camera, answerer, settings);
    const std::vector<Rect> tiles = make_tiles({0, 0, scene.film.width, scene.film.height}, k_tile_size);
    tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
    parallel_for(tiles.size(), [&](size_t i) {
      const std::vector<PixelPosition> pixels = tile_pixels(tiles[i]);
      const std::vector<SampleRange> ranges(pixels.size(), {0, uint32_t(arguments.spp)});
      trace_pixels(
          pixels, ranges, {}, settings.lobe_samples, workers.local(), [] { return true; },
          [](const PixelRun&, std::span<const Rgb>, std::span<const FirstHit>) {});
    });
    for (const TransportWorker& worker : workers) stats.merge_counters(worker.stats());
  });
  if (stats.rays_exact != 0 || stats.lookups != 0) throw Error("some shadow rays were not answered for free");
  fmt::print(
      "{{\"time\": {{\"build\": {}, \"primary\": {}, \"secondary\": {}, \"total\": {}}}, \"rays\": "
      "{{\"primary\": {}, \"shadow\": {}}}}}\n",
      stats.time_build, stats.time_primary / arguments.threads, stats.time_secondary / arguments.threads,
      stats.time_total, stats.rays_primary, stats.rays_shadow);
}

}  // namespace
}  // namespace fieldtrace

int main(int argc, char** argv) {
  try {
    fieldtrace::run(fieldtrace::parse(argc, argv));
    return 0;
  } catch (const fieldtrace::UsageError& e) {
    fmt::print(stderr, "free_visibility: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "free_visibility: {}\n", e.what());
    return 1;
  }
}
