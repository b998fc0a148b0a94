#include "tools/thesis/hybrid_rows.h"

#include <chrono>

#include "core/io/scratch_folder.h"
#include "core/platform/stopwatch.h"
#include "hybrid/render/render.h"
#include "tools/thesis/picture.h"

namespace fieldtrace {
namespace {

// Mitsuba's camera convention: left, up and forward are its axes.
Affine camera_to_world(const PhongCamera& camera) {
  const Vec3 forward = glm::normalize(camera.target - camera.eye);
  const Vec3 left = glm::normalize(glm::cross(camera.up, forward));
  return Affine(left, glm::cross(forward, left), forward, camera.eye);
}

Scene diffuse_scene(const PhongScene& phong, int size) {
  Scene scene = phong.geometry;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    Texture texture;
    texture.color0 = phong.materials[i].diffuse;
    Bsdf bsdf;
    bsdf.two_sided = true;
    bsdf.reflectance = uint32_t(scene.textures.size());
    scene.textures.push_back(texture);
    scene.instances[i].bsdf = uint32_t(scene.bsdfs.size());
    scene.bsdfs.push_back(bsdf);
  }
  for (const PhongLight& light : phong.lights) {
    const Vec3 offset = light.position - phong.camera.target;
    Emitter emitter;
    emitter.kind = EmitterKind::point;
    emitter.position = light.position;
    emitter.value = light.colour * (k_pi * glm::dot(offset, offset));
    scene.emitters.push_back(emitter);
  }
  scene.camera.to_world = camera_to_world(phong.camera);
  scene.camera.fov_x_degrees = phong.camera.fov_degrees;
  scene.film.width = scene.film.height = size;
  scene.film.crop = {0, 0, size, size};
  scene.film.filter = FilterKind::box;
  scene.film.filter_radius = 0.5f;
  scene.integrator.max_depth = 2;
  return scene;
}

PhongPicture displayed(const Image& image) {
  PhongPicture picture;
  picture.size = image.width;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const float* p = image.pixel(x, y);
      picture.pixels.push_back(glm::clamp(Rgb(p[0], p[1], p[2]), 0.0f, 1.0f));
    }
  }
  return picture;
}

struct Timed {
  RenderResult result;
  double milliseconds = 0;
};

Timed timed_render(const Scene& scene, const RenderOptions& options, const std::atomic<bool>* stop) {
  RenderCallbacks callbacks;
  callbacks.stop = stop;
  const auto start = std::chrono::steady_clock::now();
  Timed timed;
  timed.result = render(scene, options, callbacks);
  timed.milliseconds = 1e3 * seconds_since(start);
  return timed;
}

}  // namespace

bool measure_hybrid(const std::vector<PhongScene>& scenes, bool quick, const std::string& scratch_folder,
                    const std::atomic<bool>* stop, std::vector<ThesisHybridRow>& rows) {
  const int size = quick ? 64 : 512;
  for (const PhongScene& phong : scenes) {
    const Scene scene = diffuse_scene(phong, size);
    RenderOptions options;
    options.method = Method::monte_carlo;
    options.spp = quick ? 16 : 256;
    options.seed = 1;
    const Timed reference = timed_render(scene, options, stop);
    if (reference.result.interrupted) return false;
    const PhongPicture truth = displayed(reference.result.image);
    options.seed = 0;

    const auto measure = [&](const char* method) {
      ThesisHybridRow row;
      row.scene = phong.title;
      row.method = method;
      row.spp = options.spp;
      row.tolerance = options.method == Method::hybrid ? double(options.base_tolerance()) : 0.0;
      const ScratchFolder cache(scratch_folder, "field-cache");
      if (options.method == Method::hybrid) options.field_cache = cache.path();
      const Timed cold = timed_render(scene, options, stop), warm = timed_render(scene, options, stop);
      options.field_cache.clear();
      if (cold.result.interrupted || warm.result.interrupted) return false;
      row.cold_milliseconds = cold.milliseconds;
      row.milliseconds = warm.milliseconds;
      row.rms = rms_255(displayed(cold.result.image), truth);
      row.bytes = cold.result.stats.field_bytes_memory;
      rows.push_back(row);
      return true;
    };
    for (const int spp : quick ? std::vector{1, 2, 4} : std::vector{1, 4, 16}) {
      options.spp = spp;
      if (!measure("Monte Carlo")) return false;
    }
    options.method = Method::hybrid;
    options.spp = quick ? 1 : 4;
    for (const float tolerance : {0.02f, 0.1f, 0.5f}) {
      options.tolerance = tolerance;
      if (!measure("hybrid")) return false;
    }
  }
  return true;
}

}  // namespace fieldtrace
