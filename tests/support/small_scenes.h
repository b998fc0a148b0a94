// Scenes of a few shapes, made by hand for tests.
#pragma once

#include "core/material/rough_transmittance.h"
#include "core/scene/scene.h"

namespace fieldtrace::test {

inline Affine translation(const Vec3& t) {
  Affine a(1.0f);
  a[3] = t;
  return a;
}
inline Affine scaling(const Vec3& s) { return Affine(Vec3(s.x, 0, 0), Vec3(0, s.y, 0), Vec3(0, 0, s.z), Vec3(0)); }

// A camera at `from` that looks at `to` (Mitsuba's look-at: +x points to the left of the picture).
inline Affine look_at(const Vec3& from, const Vec3& to, const Vec3& up) {
  const Vec3 z = glm::normalize(to - from), x = glm::normalize(glm::cross(up, z));
  return Affine(x, glm::cross(z, x), z, from);
}

struct SceneMaker {
  Scene scene;

  SceneMaker() {
    scene.film.width = scene.film.height = 16;
    scene.film.crop = {0, 0, 16, 16};
    scene.film.filter = FilterKind::box;
    scene.film.filter_radius = 0.5f;
    scene.integrator.max_depth = 2;
    scene.sample_count = 4;
  }

  void film(int width, int height) {
    scene.film.width = width;
    scene.film.height = height;
    scene.film.crop = {0, 0, width, height};
  }

  uint32_t constant(const Rgb& value) {
    Texture t;
    t.color0 = value;
    scene.textures.push_back(t);
    return uint32_t(scene.textures.size() - 1);
  }

  uint32_t bsdf(BsdfKind kind, const Rgb& reflectance) {
    Bsdf b;
    b.kind = kind;
    b.reflectance = b.transmittance = b.diffuse_reflectance = constant(reflectance);
    if (kind == BsdfKind::rough_plastic) {
      b.rough_transmittance = uint32_t(scene.rough_transmittances.size());
      scene.rough_transmittances.push_back(
          make_rough_transmittance({b.microfacet, b.alpha_u, b.alpha_v}, b.int_ior / b.ext_ior));
    }
    scene.bsdfs.push_back(b);
    return uint32_t(scene.bsdfs.size() - 1);
  }

  // A metal with GGX roughness alpha.
  uint32_t metal(float alpha) {
    const uint32_t index = bsdf(BsdfKind::rough_conductor, Rgb(0.9f));
    Bsdf& b = scene.bsdfs[index];
    b.microfacet = MicrofacetKind::ggx;
    b.alpha_u = b.alpha_v = alpha;
    return index;
  }

  // A copy of a material with that opacity.
  uint32_t masked(uint32_t bsdf_index, float opacity) {
    Bsdf b = scene.bsdfs[bsdf_index];
    b.opacity = constant(Rgb(opacity));
    scene.bsdfs.push_back(b);
    return uint32_t(scene.bsdfs.size() - 1);
  }

  uint32_t shape(ShapeKind kind) {
    Shape s;
    s.kind = kind;
    s.name = "shape";
    s.bounds.extend(Vec3(-1, -1, kind == ShapeKind::sphere ? -1 : 0));
    s.bounds.extend(Vec3(1, 1, kind == ShapeKind::sphere || kind == ShapeKind::cylinder ? 1 : 0));
    if (kind == ShapeKind::rectangle) {
      s.mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
      s.mesh.texcoords = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
      s.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    }
    scene.shapes.push_back(s);
    return uint32_t(scene.shapes.size() - 1);
  }

  uint32_t mesh(const TriangleMesh& m) {
    Shape s;
    s.name = "mesh";
    s.mesh = m;
    s.bounds = m.bounds();
    scene.shapes.push_back(s);
    return uint32_t(scene.shapes.size() - 1);
  }

  uint32_t instance(uint32_t shape_index, uint32_t bsdf_index, const Affine& to_world) {
    Instance i;
    i.shape = shape_index;
    i.bsdf = bsdf_index;
    i.to_world = to_world;
    i.to_object = Affine(inverse_affine(DAffine(to_world)));
    scene.instances.push_back(i);
    return uint32_t(scene.instances.size() - 1);
  }

  // A floor of half width 6 at y = 0, facing up, under a small bright lamp.
  void lit_floor(uint32_t floor_bsdf, uint32_t lamp_bsdf) {
    instance(shape(ShapeKind::rectangle), floor_bsdf, Affine(Vec3(6, 0, 0), Vec3(0, 0, -6), Vec3(0, 6, 0), Vec3(0)));
    const Affine lamp(Vec3(0.4f, 0, 0), Vec3(0, 0.4f, 0), Vec3(0, 0, 0.4f), Vec3(2, 4, 2));
    area_light(instance(shape(ShapeKind::sphere), lamp_bsdf, lamp), Rgb(60.0f));
  }

  void area_light(uint32_t instance_index, const Rgb& radiance) {
    Emitter e;
    e.value = radiance;
    e.instance = instance_index;
    scene.instances[instance_index].emitter = uint32_t(scene.emitters.size());
    scene.emitters.push_back(e);
  }

  // A map of `width` x `height` texels, each `texel(x, y)`.
  template <class Texel>
  void environment(int width, int height, const Texel& texel, const Mat3& rotation = Mat3(1.0f)) {
    Emitter e;
    e.kind = EmitterKind::environment;
    e.rotation = rotation;
    e.bitmap = uint32_t(scene.bitmaps.size());
    Bitmap map;
    map.width = width;
    map.height = height;
    for (int i = 0; i < width * height; ++i) map.pixels.push_back(texel(i % width, i / width));
    scene.bitmaps.push_back(map);
    scene.emitters.push_back(e);
  }

  void light(EmitterKind kind, const Rgb& value, const Vec3& place = Vec3(0.0f)) {
    Emitter e;
    e.kind = kind;
    e.value = value;
    if (kind == EmitterKind::point) e.position = place;
    if (kind == EmitterKind::directional) e.direction = place;
    scene.emitters.push_back(e);
  }
};

}  // namespace fieldtrace::test
