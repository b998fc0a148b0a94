// One batch of shadow rays, answered as the renderer answers its own, and by ftOccluded(); for python_occlusion.py,
// which asks the same of the Python package.
//
//   occlusion_batch FILE
//
// FILE: uint32 numbers of positions, triangles and rays; then, packed, float[3] positions, uint32[3] triangles,
// float[3] origins, float[3] directions and float tmax (finite). Reads lines "MODE REPEATS" from standard input and
// answers each with the user seconds of the process, and how many rays of the batch are blocked. Modes: "renderer"
// (batches of the renderer's kind that are filled beforehand, ShadowAnswerer) and "library" (ftOccluded).
#include <sys/resource.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "core/platform/parallel.h"
#include "hybrid/api/scene_object.h"

using namespace fieldtrace;

namespace {

constexpr size_t k_rays_of_chunk = 4096;  // as the library's, and a renderer's batch of camera samples

double user_seconds() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_utime.tv_sec) + 1e-6 * double(usage.ru_utime.tv_usec);
}

void require_ok(FTError code, FTDevice device) {
  if (code == FT_ERROR_NONE) return;
  const char* message = "";
  if (ftGetDeviceError(device, &message) != code) ftGetDeviceError(nullptr, &message);
  throw Error(message);
}

struct Input {
  std::vector<float> positions, origins, directions, t_max;
  std::vector<uint32_t> triangles;

  explicit Input(const char* path) {
    std::ifstream file(path, std::ios::binary);
    uint32_t counts[3] = {};
    file.read(reinterpret_cast<char*>(counts), sizeof counts);
    const auto read = [&](auto& values, size_t count) {
      values.resize(count);
      file.read(reinterpret_cast<char*>(values.data()), std::streamsize(count * sizeof values[0]));
    };
    read(positions, size_t(3) * counts[0]), read(triangles, size_t(3) * counts[1]);
    read(origins, size_t(3) * counts[2]), read(directions, size_t(3) * counts[2]), read(t_max, counts[2]);
    if (!file) throw Error(std::string(path) + ": cannot be read, or is too short");
  }
};

struct Chunk {
  ShadowBatch batch;
  ShadowGroup group;
  Bounds3 origins;
};

std::vector<Chunk> chunks_of(const Input& in) {
  const size_t count = in.t_max.size();
  std::vector<Chunk> chunks((count + k_rays_of_chunk - 1) / k_rays_of_chunk);
  for (size_t c = 0; c < chunks.size(); ++c) {
    Chunk& chunk = chunks[c];
    const size_t begin = c * k_rays_of_chunk, end = std::min(count, begin + k_rays_of_chunk);
    chunk.batch.resize(end - begin);
    for (size_t i = begin; i < end; ++i) {
      const Vec3 o(in.origins[3 * i], in.origins[3 * i + 1], in.origins[3 * i + 2]);
      const Vec3 d(in.directions[3 * i], in.directions[3 * i + 1], in.directions[3 * i + 2]);
      chunk.batch.rays.set(i - begin, o, d, in.t_max[i]);
      chunk.batch.instance[i - begin] = k_none;
      chunk.origins.extend(o);
      chunk.group.light.bounds.extend(o + in.t_max[i] * d);
    }
    const Bounds3& ends = chunk.group.light.bounds;
    chunk.group.light.ball = {ends.centre(), 0.5f * glm::length(ends.diagonal())};
  }
  return chunks;
}

void answer(const api::SceneObject& s, std::vector<Chunk>& chunks) {
  s.device->arena.execute([&] {
    parallel_for(chunks.size(), [&](size_t c) {
      Chunk& chunk = chunks[c];
      std::fill(chunk.batch.blocked.begin(), chunk.batch.blocked.end(), uint8_t(0));
      std::fill(chunk.batch.exact.begin(), chunk.batch.exact.end(), uint8_t(0));
      Stats stats;
      s.shadows->find_ray_candidates(chunk.origins, chunk.group);
      s.shadows->answer({chunk.group, chunk.batch, stats});
    });
  });
}

void run(const char* path) {
  const Input in(path);
  FTDevice device = nullptr;
  FTScene scene = nullptr;
  require_ok(ftNewDevice(0, &device), nullptr);
  require_ok(ftNewScene(device, &scene), device);
  require_ok(ftAddMesh(scene, in.positions.data(), 0, in.positions.size() / 3, in.triangles.data(), 0,
                       in.triangles.size() / 3, nullptr),
             device);
  require_ok(ftAddInstance(scene, 0, nullptr, nullptr), device);
  require_ok(ftCommitScene(scene), device);
  std::vector<Chunk> chunks = chunks_of(in);
  const size_t count = in.t_max.size();

  std::string mode;
  for (int repeats = 0; std::cin >> mode >> repeats;) {
    size_t blocked = 0;
    const double begin = user_seconds();
    for (int r = 0; r < repeats; ++r) {
      if (mode == "renderer") {
        answer(*api::find(scene), chunks);
      } else {
        // As Python does, into a new array.
        std::vector<uint8_t> results(count);
        require_ok(ftOccluded(scene, in.origins.data(), 0, in.directions.data(), 0, in.t_max.data(), 0, nullptr, 0,
                              count, results.data(), 0),
                   device);
        if (r == 0) blocked = size_t(std::count(results.begin(), results.end(), uint8_t(1)));
      }
    }
    const double seconds = user_seconds() - begin;
    if (mode == "renderer") {
      for (const Chunk& chunk : chunks)
        blocked +=
            size_t(std::count_if(chunk.batch.blocked.begin(), chunk.batch.blocked.begin() + chunk.batch.rays.size,
                                 [](uint8_t b) { return b != 0; }));
    }
    std::cout << seconds << " " << blocked << std::endl;
  }
  ftReleaseScene(scene), ftReleaseDevice(device);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 2) throw Error("usage: occlusion_batch FILE");
    run(argv[1]);
    return 0;
  } catch (const std::exception& e) {
    std::cerr << "occlusion_batch: " << e.what() << "\n";
    return 1;
  }
}
