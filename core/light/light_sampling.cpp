#include "core/light/light_sampling.h"

#include <algorithm>

#include "core/light/light_kernels.h"
#include "core/light/light_shapes.hd.h"
#include "core/simd/vec_lanes.h"

namespace fieldtrace {

void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points, int light_samples,
                  Isa isa, ShadowBatch& out) {
  sample_light(lights, light, shading_points, {light_samples, 0, light_samples}, isa, out);
}

void sample_light(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                  const LightSampleRange& range, Isa isa, ShadowBatch& out) {
  const LightKernel kernel = light_kernel_for(resolve_isa(isa));
  out.resize(shading_points.size * size_t(range.count));
  out.source = {&lights, light, &shading_points, range};
  out.active = 0;
  if (range.cell_columns > 0) out.cell.assign(padded(out.rays.size), 0);
  if (lights.lights[light].kind == LightKind::none) {
    std::fill(out.rays.tmax.begin(), out.rays.tmax.end(), -1.0f);
    std::fill(out.rays.dz.begin(), out.rays.dz.end(), 1.0f);
    for (auto* v : {&out.rays.ox, &out.rays.oy, &out.rays.oz, &out.rays.dx, &out.rays.dy, &out.weight, &out.pdf}) {
      std::fill(v->begin(), v->end(), 0.0f);
    }
    for (size_t i = 0; i < out.rays.size; ++i) out.instance[i] = shading_points.instance[i / size_t(range.count)];
    return;
  }
  if (lights.lights[light].kind == LightKind::environment) {
    for (auto* v : {&out.red, &out.green, &out.blue}) v->resize(padded(out.rays.size));
  }
  kernel(lights, light, shading_points, range, out);
}

Rgb emitted_radiance(const LightTable& lights, uint32_t index, const Vec3& direction) {
  const Light& light = lights.lights[index];
  const Rgb value(light.value[0], light.value[1], light.value[2]);
  if (light.kind != LightKind::environment) return value;
  return value * environment_radiance(lights.environment, light, direction);
}

bool sampled_in_closed_form(const Light& light) {
  return light.kind == LightKind::sphere || light.kind == LightKind::rectangle || light.kind == LightKind::point ||
         light.kind == LightKind::directional;
}

namespace {

// Solid-angle density of choosing a surface point by area.
float area_pdf(const Vec3& direction, const LightHit& hit, float density) {
  const float length = glm::length(direction);
  const float distance = hit.t * length;
  const float cosine = std::fabs(glm::dot(hit.normal, direction)) / length;
  const float inverse_pdf = cosine / density / distance / distance;
  return 1.0f / std::max(inverse_pdf, scalar::Tiny::k_smallest_normal);
}

// Ellipsoids and cylinders: the unit shape's normal at the hit gives the Jacobian, as in AffineShape::sample.
float affine_pdf(const Light& light, const Vec3& from_centre, const Vec3& direction, const LightHit& hit) {
  Vec3 unit(0.0f);  // L^-1 from_centre up to the sign of the emission
  const int coordinates = light.kind == LightKind::cylinder ? 2 : 3;
  for (int i = 0; i < coordinates; ++i) {
    unit[i] = glm::dot(Vec3(light.normal_axis[i][0], light.normal_axis[i][1], light.normal_axis[i][2]), from_centre);
  }
  const float size = glm::length(unit);
  if (!(size > 0.0f)) return 0.0f;
  Vec3 normal(0.0f);
  for (int i = 0; i < coordinates; ++i) {
    normal += unit[i] / size * Vec3(light.normal_axis[i][0], light.normal_axis[i][1], light.normal_axis[i][2]);
  }
  // `unit` carries the sign once and the axes carry it again, so `normal` points outwards for either sign.
  if (!(light.emission_sign * glm::dot(normal, direction) < 0.0f)) return 0.0f;
  return area_pdf(direction, hit, 1.0f / (light.area * glm::length(normal)));
}

}  // namespace

float light_pdf(const LightTable& lights, uint32_t index, const Vec3& from, const Vec3& shading_normal, bool transmits,
                const Vec3& direction, const LightHit& hit) {
  const Light& light = lights.lights[index];
  scalar::LightShadingPoint<float> shading_point = {lanes(from), lanes(shading_normal), 0.0f, transmits ? 1.0f : 0.0f};
  shading_point.delta =
      light.error_base + light.error_slope * (std::fabs(from.x) + std::fabs(from.y) + std::fabs(from.z));
  const Vec3 centre(light.centre[0], light.centre[1], light.centre[2]);
  const Vec3 plane_normal(light.normal[0], light.normal[1], light.normal[2]);
  switch (light.kind) {
    case LightKind::none:
    case LightKind::point:
    case LightKind::directional:
      return 0.0f;
    case LightKind::constant: {
      if (transmits) return scalar::Angle::k_inv_four_pi;
      return std::max(glm::dot(shading_normal, direction) / glm::length(direction), 0.0f) * scalar::Angle::k_inv_pi;
    }
    case LightKind::environment:
      return environment_density(lights.environment, light, direction);
    case LightKind::sphere:
      if (glm::length(centre - from) < light.radius + shading_point.delta) return 0.0f;
      return scalar::SphereLight<float>(light).setup(shading_point).pdf;
    case LightKind::rectangle: {
      const auto setup = scalar::RectangleLight<float>(light).setup(shading_point);
      if (setup.height < shading_point.delta) return 0.0f;
      if (setup.turns < 0.0f) return area_pdf(direction, hit, 1.0f / light.area);
      return 1.0f / setup.inverse_pdf;
    }
    case LightKind::parallelogram:
    case LightKind::disk:
      if (glm::dot(plane_normal, from - centre) < shading_point.delta) return 0.0f;
      return area_pdf(direction, hit, 1.0f / light.area);
    case LightKind::sphere_inside:
    case LightKind::ellipsoid:
    case LightKind::cylinder:
      return affine_pdf(light, from + hit.t * direction - centre, direction, hit);
    case LightKind::mesh: {
      const LightTriangle& t = lights.triangles[light.first_triangle + hit.primitive];
      const Vec3 normal(t.normal[0], t.normal[1], t.normal[2]);
      if (!(glm::dot(normal, direction) < 0.0f) || !(t.inverse_density > 0.0f)) return 0.0f;
      return area_pdf(direction, hit, 1.0f / t.inverse_density);
    }
  }
  return 0.0f;
}

}  // namespace fieldtrace
