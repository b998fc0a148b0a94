#include "hybrid/api/api_points.h"

#include <cmath>

namespace fieldtrace::api {
namespace {

// How far the length of a normal may be from 1.
constexpr float k_unit_slack = 1e-3f;

}  // namespace

void require_points(const SceneObject& s, const PointBuffers& p) {
  p.points.needed(), p.normals.needed();
  for (size_t i = 0; i < p.count(); ++i) {
    const uint32_t from = p.instance_of(i);
    const char* fault = nullptr;
    const Vec3 position = vector_at(p.points, i);
    if (!is_within(position, s.largest_coordinate)) fault = "lies too far from the scene";
    if (!is_finite(position)) fault = "is not finite";
    if (!(std::abs(glm::length(vector_at(p.normals, i)) - 1.0f) < k_unit_slack))
      fault = "has a normal that is not unit";
    if (from != k_none && from >= s.scene.instances.size()) fault = "lies on an instance that is not there";
    if (fault) throw Failure(FT_ERROR_INVALID_ARGUMENT, "point " + std::to_string(i) + " " + fault);
  }
}

void set_point(const PointBuffers& from, size_t i, ShadingPointBatch& to, size_t j) {
  const Vec3 p = vector_at(from.points, i), n = vector_at(from.normals, i);
  to.px[j] = p.x, to.py[j] = p.y, to.pz[j] = p.z;
  to.gx[j] = to.sx[j] = n.x, to.gy[j] = to.sy[j] = n.y, to.gz[j] = to.sz[j] = n.z;
  // Of a point of a triangle by its barycentric coordinates, transformed.
  to.error[j] = gamma_bound(8) * (std::abs(p.x) + std::abs(p.y) + std::abs(p.z));
  to.radius[j] = 0.0f;
  to.seed[j] = to.sample[j] = 0;
  to.instance[j] = from.instance_of(i);
  to.transmits[j] = 0;
}

}  // namespace fieldtrace::api
