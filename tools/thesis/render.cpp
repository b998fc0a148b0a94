#include "tools/thesis/render.h"

#include <algorithm>
#include <cmath>

#include "core/platform/parallel.h"
#include "core/sampling/warp.hd.h"
#include "core/surface/surface.h"

namespace fieldtrace {
namespace {

constexpr int k_tile = 64;

// The pixel that a ray contributes to, and its weight.
struct Path {
  uint32_t pixel = 0;  // of the tile
  float weight = 1.0f;
};

// A pinhole camera as an affine map from image coordinates to directions.
struct CameraRays {
  Vec3 corner, right, down;

  CameraRays(const PhongCamera& camera, int size) {
    const Vec3 forward = glm::normalize(camera.target - camera.eye);
    const Vec3 across = glm::normalize(glm::cross(forward, camera.up)), above = glm::cross(across, forward);
    const float half = std::tan(0.5f * camera.fov_degrees * k_pi / 180.0f), pixel = 2.0f * half / float(size);
    right = across * pixel;
    down = -above * pixel;
    corner = forward - across * half + above * half;
  }
  Vec3 through(int x, int y) const {
    return glm::normalize(corner + right * (float(x) + 0.5f) + down * (float(y) + 0.5f));
  }
};

// Phong's lighting of a surface by one unoccluded light.
Rgb lit_colour(const PhongMaterial& material, const PhongLight& light, const PhongSurface& s, const Vec3& view) {
  const Vec3 to_light = glm::normalize(light.position - s.position);
  const float facing = glm::dot(s.normal, to_light);
  if (facing <= 0.0f) return Rgb(0.0f);
  const Vec3 mirrored = s.normal * (2.0f * facing) - to_light;
  const float highlight = std::max(glm::dot(mirrored, -view), 0.0f);
  return light.colour * (material.diffuse * facing + material.specular * std::pow(highlight, material.shininess));
}

// A number in [0, 1) from two words (the last steps of XXH32). It chooses directions, so pictures depend on its bits.
float hashed(uint32_t a, uint32_t b) {
  uint32_t h = a * 2654435761u ^ (b * 2246822519u + 374761393u);
  h = (h ^ (h >> 15)) * 2246822519u;
  h = (h ^ (h >> 13)) * 3266489917u;
  h ^= h >> 16;
  return float(h >> 8) * 0x1p-24f;
}

// Ray k of 4 in the cone of tangent `radius` about `axis`: jittered in its quarter of the disk, kept above the surface.
Vec3 polished_direction(const Vec3& axis, const Vec3& normal, float radius, uint32_t seed, uint32_t k) {
  const float u = 0.5f * (float(k & 1) + hashed(seed, 2 * k)), v = 0.5f * (float(k >> 1) + hashed(seed, 2 * k + 1));
  const auto disk = scalar::concentric_disk<float>(u, v);
  const auto basis = scalar::make_basis<float>({axis.x, axis.y, axis.z});
  const Vec3 x(basis.x.x, basis.x.y, basis.x.z), y(basis.y.x, basis.y.y, basis.y.z);
  const float r = disk.radius * radius;
  const Vec3 d = glm::normalize(axis + x * (r * disk.cosine) + y * (r * disk.sine));
  const float below = glm::dot(d, normal);
  return below > 0.0f ? d : glm::normalize(d - normal * (2.0f * below));
}

class TileRenderer {
 public:
  TileRenderer(const PhongScene& scene, const PhongTracer& tracer, const PhongRenderOptions& options,
               const CameraRays& camera)
      : scene_(scene), tracer_(tracer), options_(options), camera_(camera) {}

  void render(int x0, int y0, PhongPicture& picture) {
    const int width = std::min(k_tile, picture.size - x0), height = std::min(k_tile, picture.size - y0);
    const size_t count = size_t(width) * size_t(height);
    colours_.assign(count, Rgb(0.0f));
    seed_ = uint32_t(y0) * 65536u + uint32_t(x0);
    batch_.rays.resize(count);
    batch_.skip.assign(padded(count), k_none);
    paths_.resize(count);
    for (uint32_t i = 0; i < count; ++i) {
      const Vec3 d = camera_.through(x0 + int(i) % width, y0 + int(i) / width);
      batch_.rays.set(i, scene_.camera.eye, d, k_infinity);
      paths_[i] = {i, 1.0f};
    }
    for (int depth = 0; batch_.rays.size > 0; ++depth) {
      tracer_.nearest(batch_, depth == 0);
      shade(depth < scene_.reflections);
      reflect(uint32_t(depth));
    }
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        picture.pixels[size_t(y0 + y) * size_t(picture.size) + size_t(x0 + x)] =
            glm::clamp(colours_[size_t(y) * size_t(width) + size_t(x)], 0.0f, 1.0f);
      }
    }
  }

 private:
  // Weight of the surface's own colour: 1 where no reflected ray follows.
  float surface_share(const PhongSurface& s, bool reflects) const {
    return reflects ? 1.0f - scene_.materials[s.instance].mirror : 1.0f;
  }

  // Adds emission and ambient light of the surfaces hit, or the background; then all lights with their shadows.
  void shade(bool reflects) {
    reflects_ = reflects;
    for (size_t i = 0; i < batch_.rays.size; ++i) {
      const PhongSurface& s = batch_.surfaces[i];
      const Path& path = paths_[i];
      if (s.instance == k_none) {
        colours_[path.pixel] += path.weight * scene_.background;
        continue;
      }
      const PhongMaterial& m = scene_.materials[s.instance];
      colours_[path.pixel] += path.weight * surface_share(s, reflects) * (m.emission + m.ambient * scene_.ambient);
    }
    for (const PhongLight& light : scene_.lights) {
      batch_.shading_points.clear();
      for (uint32_t i = 0; i < batch_.rays.size; ++i) {
        const PhongSurface& s = batch_.surfaces[i];
        if (s.instance != k_none && glm::dot(s.normal, light.position - s.position) > 0.0f) {
          batch_.shading_points.push_back(i);
        }
      }
      tracer_.shadow(batch_, light.position);
      for (size_t k = 0; k < batch_.shading_points.size(); ++k) {
        if (batch_.hidden[k]) continue;
        const uint32_t i = batch_.shading_points[k];
        const PhongSurface& s = batch_.surfaces[i];
        const Rgb c = lit_colour(scene_.materials[s.instance], light, s, batch_.rays.direction(i));
        colours_[paths_[i].pixel] += paths_[i].weight * surface_share(s, reflects) * c;
      }
    }
  }

  // Reflection: the mirrors' rays become the next batch.
  void reflect(uint32_t depth) {
    next_paths_.clear();
    origins_.clear();
    directions_.clear();
    left_.clear();
    const uint32_t rays = uint32_t(options_.reflection_rays);
    for (uint32_t i = 0; reflects_ && i < batch_.rays.size; ++i) {
      const PhongSurface& s = batch_.surfaces[i];
      if (s.instance == k_none || scene_.materials[s.instance].mirror <= 0.0f) continue;
      const float weight = paths_[i].weight * scene_.materials[s.instance].mirror / float(rays);
      const Vec3 d = batch_.rays.direction(i);
      const Vec3 mirrored = glm::normalize(d - s.normal * (2.0f * glm::dot(d, s.normal)));
      for (uint32_t k = 0; k < rays; ++k) {
        const uint32_t seed = (seed_ + i * 8u) ^ (depth << 28);
        const Vec3 r = rays == 1 ? mirrored : polished_direction(mirrored, s.normal, scene_.polish_radius, seed, k);
        next_paths_.push_back({paths_[i].pixel, weight});
        origins_.push_back(offset_origin(s.position, s.geometric, s.error, r));
        directions_.push_back(r);
        left_.push_back(s.instance);
      }
    }
    const size_t count = next_paths_.size();
    batch_.rays.resize(count);
    batch_.skip.assign(padded(count), k_none);
    for (size_t i = 0; i < count; ++i) {
      batch_.rays.set(i, origins_[i], directions_[i], k_infinity);
      batch_.skip[i] = left_[i];
    }
    paths_.swap(next_paths_);
  }

  const PhongScene& scene_;
  const PhongTracer& tracer_;
  const PhongRenderOptions& options_;
  const CameraRays& camera_;
  bool reflects_ = false;
  uint32_t seed_ = 0;
  TracerBatch batch_;
  std::vector<Rgb> colours_;
  std::vector<Path> paths_, next_paths_;
  std::vector<Vec3> origins_, directions_;
  std::vector<uint32_t> left_;
};

}  // namespace

PhongPicture render_phong(const PhongScene& scene, const PhongTracer& tracer, const PhongRenderOptions& options) {
  PhongPicture picture;
  picture.size = options.size;
  picture.pixels.assign(size_t(options.size) * size_t(options.size), Rgb(0.0f));
  const CameraRays camera(scene.camera, options.size);
  const int side = (options.size + k_tile - 1) / k_tile;
  parallel_for(size_t(side) * size_t(side), [&](size_t tile) {
    TileRenderer renderer(scene, tracer, options, camera);
    renderer.render(int(tile) % side * k_tile, int(tile) / side * k_tile, picture);
  });
  return picture;
}

}  // namespace fieldtrace
