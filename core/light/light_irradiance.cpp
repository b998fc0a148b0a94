#include "core/light/light_irradiance.h"

#include "core/light/light_irradiance.hd.h"
#include "core/light/light_kernels.h"
#include "core/math/math.h"

namespace fieldtrace {
namespace {

// Whether the half axes of a disk are equally long and orthogonal, but for the roundings of its transform (as
// k_similarity_tolerance in light_table.cpp).
constexpr double k_circle_tolerance = gamma_bound(16);

bool circular(const Light& disk) {
  const DVec3 x(disk.axis[0][0], disk.axis[0][1], disk.axis[0][2]),
      y(disk.axis[1][0], disk.axis[1][1], disk.axis[1][2]);
  const double xx = glm::dot(x, x), error = 2.0 * k_circle_tolerance * xx;
  return std::abs(glm::dot(y, y) - xx) <= error && std::abs(glm::dot(x, y)) <= error;
}

bool has_closed_form(const Light& light) {
  return light.kind == LightKind::sphere || light.kind == LightKind::rectangle ||
         light.kind == LightKind::parallelogram || (light.kind == LightKind::disk && circular(light));
}

}  // namespace

void irradiance_vectors(const Light& light, const ShadingPointBatch& points, Isa isa, IrradianceVectors& out) {
  for (auto* v : {&out.x, &out.y, &out.z}) v->assign(padded(points.size), 0.0f);
  out.known.assign(padded(points.size), 0);
  if (!has_closed_form(light)) return;
  irradiance_vectors_kernel_for(isa)(light, points, out);
  for (size_t i = 0; i < points.size; ++i) {
    out.known[i] = out.x[i] < float(scalar::k_no_vector) ? 1 : 0;
    if (out.known[i] == 0) out.x[i] = out.y[i] = out.z[i] = 0.0f;
  }
}

void whole_irradiance(const Light& light, const ShadingPointBatch& points, Isa isa, AlignedVector<float>& irradiance) {
  irradiance.resize(padded(points.size));
  irradiance_kernel_for(isa)(light, points, irradiance.data());
}

}  // namespace fieldtrace
