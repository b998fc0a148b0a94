// Scenes of one light, batches of shading points and double-precision references, shared by the light tests.
#pragma once

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "core/light/light_sampling.h"
#include "core/sampling/sobol.hd.h"

namespace fieldtrace::light_test {

inline Scene area_scene(const Shape& shape, const DAffine& to_world, bool flip = false) {
  Scene scene;
  scene.shapes.push_back(shape);
  Instance instance;
  instance.to_world = Affine(to_world);
  instance.to_object = Affine(inverse_affine(to_world));
  instance.flip_normals = flip;
  scene.instances.push_back(instance);
  Emitter emitter;
  emitter.instance = 0;
  scene.emitters.push_back(emitter);
  return scene;
}

inline Scene area_scene(ShapeKind kind, const DAffine& to_world, bool flip = false) {
  Shape shape;
  shape.kind = kind;
  return area_scene(shape, to_world, flip);
}

inline Scene emitter_scene(EmitterKind kind) {
  Scene scene;
  Emitter emitter;
  emitter.kind = kind;
  emitter.position = Vec3(0.5f, -0.25f, 3.0f);
  emitter.direction = glm::normalize(Vec3(0.2f, 0.1f, -1.0f));
  scene.emitters.push_back(emitter);
  return scene;
}

// A map of `width` x `height` texels, each `texel(x, y)`, as the only light.
inline Scene environment_scene(int width, int height, const std::function<Rgb(int, int)>& texel,
                               const Mat3& rotation = Mat3(1.0f)) {
  Scene scene = emitter_scene(EmitterKind::environment);
  scene.emitters[0].bitmap = 0;
  scene.emitters[0].rotation = rotation;
  Bitmap map;
  map.width = width;
  map.height = height;
  for (int i = 0; i < width * height; ++i) map.pixels.push_back(texel(i % width, i / width));
  scene.bitmaps.push_back(map);
  return scene;
}

// Dark coloured noise with a bright spot.
inline Rgb spotted_texel(int x, int y) {
  const float noise = float(scalar::hash_uint(uint32_t(x * 977 + y + 1)) >> 8) * 0x1p-24f;
  return x == 5 && y == 3 ? Rgb(80.0f, 60.0f, 40.0f) : Rgb(noise, 0.5f * noise, 1.0f - noise);
}

inline DAffine affine(const DVec3& x, const DVec3& y, const DVec3& z, const DVec3& origin) {
  return DAffine(x, y, z, origin);
}
inline DAffine scaled(double s, const DVec3& origin) {
  return affine(DVec3(s, 0, 0), DVec3(0, s, 0), DVec3(0, 0, s), origin);
}

// A random rotation (its columns are orthonormal to double precision).
inline DMat3 random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const DVec3 a = glm::normalize(DVec3(normal(random), normal(random), normal(random)));
  const DVec3 b = glm::normalize(glm::cross(a, DVec3(normal(random), normal(random), normal(random))));
  return DMat3(a, b, glm::cross(a, b));
}

// Five triangles of unequal area, some of them tiny and one degenerate.
inline Shape mesh_shape() {
  Shape shape;
  shape.kind = ShapeKind::mesh;
  shape.mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {0, 1, 0.5f}, {0.9f, 0.9f, -0.5f}, {0.9f, 0.91f, -0.5f}};
  shape.mesh.triangles = {{0, 1, 2}, {1, 3, 2}, {3, 4, 2}, {0, 1, 1}, {1, 4, 3}};
  return shape;
}

struct ShadingPoint {
  Vec3 point = Vec3(0.0f), normal = Vec3(0.0f, 0.0f, 1.0f), shading = Vec3(0.0f, 0.0f, 1.0f);
  float error = 0.0f;
  bool transmits = false;
};

inline ShadingPointBatch batch_of(const std::vector<ShadingPoint>& shading_points, uint32_t seed) {
  ShadingPointBatch b;
  b.resize(shading_points.size());
  for (size_t i = 0; i < shading_points.size(); ++i) {
    const ShadingPoint& r = shading_points[i];
    b.px[i] = r.point.x, b.py[i] = r.point.y, b.pz[i] = r.point.z;
    b.gx[i] = r.normal.x, b.gy[i] = r.normal.y, b.gz[i] = r.normal.z;
    b.sx[i] = r.shading.x, b.sy[i] = r.shading.y, b.sz[i] = r.shading.z;
    b.error[i] = r.error;
    b.seed[i] = scalar::vertex_seed(seed, uint32_t(i), 0, 0);
    b.sample[i] = uint32_t(i % 5);
    b.instance[i] = uint32_t(i + 7);
    b.transmits[i] = r.transmits ? 1 : 0;
  }
  return b;
}

// Mean of the weights: irradiance by unit radiance (or by the delta light's unit value), without visibility.
inline double irradiance(const LightTable& lights, const ShadingPoint& shading_point, int samples, uint32_t seed) {
  ShadowBatch out;
  ShadingPointBatch b = batch_of({shading_point}, seed);
  b.sample[0] = 0;
  sample_light(lights, 0, b, samples, Isa::automatic, out);
  double sum = 0.0;
  for (int k = 0; k < samples; ++k) sum += double(out.weight[size_t(k)]);
  return sum / samples;
}

// Lambert's formula: irradiance from a polygon of unit radiance, vertices seen clockwise or not, all above the horizon.
inline double polygon_irradiance(const std::vector<DVec3>& vertices, const DVec3& point, const DVec3& normal) {
  DVec3 sum(0.0);
  for (size_t i = 0; i < vertices.size(); ++i) {
    const DVec3 a = vertices[i] - point, b = vertices[(i + 1) % vertices.size()] - point;
    const DVec3 cross = glm::cross(a, b);
    const double sine = glm::length(cross);
    if (sine > 0) sum += cross / sine * std::atan2(sine, glm::dot(a, b));
  }
  return std::fabs(glm::dot(sum, normal)) / 2.0;
}

// Irradiance by the midpoint rule over a parametrised surface: `surface(a, b)` for (a, b) in [0, 1]^2.
inline double quadrature_irradiance(const std::function<DVec3(double, double)>& surface, const DVec3& point,
                                    const DVec3& normal, double side, int n) {
  double sum = 0.0;
  const double h = 1.0 / n, step = h * 1e-3;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double a = (i + 0.5) * h, b = (j + 0.5) * h;
      const DVec3 da = (surface(a + step, b) - surface(a - step, b)) / (2.0 * step);
      const DVec3 db = (surface(a, b + step) - surface(a, b - step)) / (2.0 * step);
      const DVec3 d = surface(a, b) - point;
      const double r2 = glm::dot(d, d);
      const double facing = -side * glm::dot(glm::cross(da, db), d), cosine = glm::dot(normal, d);
      if (facing > 0 && cosine > 0) sum += facing * cosine / (r2 * r2) * h * h;
    }
  }
  return sum;
}

}  // namespace fieldtrace::light_test
