// One mesh with its acceleration structure and field, queried next to Embree, for the tests of fields.
//
// Space: object space. Thread-safety: one thread each.
#pragma once

#include <memory>
#include <vector>

#include "core/trace/accel.h"
#include "field/bake/single_ray_query.h"
#include "field/store/risk_classes.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {

class FieldFixture {
 public:
  explicit FieldFixture(TriangleMesh mesh, const FieldParameters& parameters = {}) {
    Shape shape;
    shape.mesh = std::move(mesh);
    shape.bounds = shape.mesh.bounds();
    scene_.shapes.push_back(std::move(shape));
    accel_ = std::make_unique<Accel>(scene_);
    field_ = std::make_unique<Field>(field_ball(scene_.shapes[0].bounds), parameters);
    probe_ = std::make_unique<SingleRayQuery>(*field_, *accel_, 0);
  }

  Field& field() { return *field_; }
  const Accel& accel() const { return *accel_; }
  SingleRayQuery& probe() { return *probe_; }
  const TriangleMesh& mesh() const { return scene_.shapes[0].mesh; }
  const Sphere& ball() const { return field_->ball(); }

  bool embree_blocked(const Vec3& o, const Vec3& d, float t_max) {
    rays_.resize(1);
    rays_.set(0, o, d, t_max);
    uint8_t blocked[k_batch_padding] = {};
    accel_->shape_occluded(0, rays_, blocked);
    return blocked[0] != 0;
  }
  // Distance to the nearest hit; negative: a miss.
  float embree_nearest(const Vec3& o, const Vec3& d, float t_max, Vec3* normal = nullptr) {
    rays_.resize(1);
    hits_.resize(1);
    rays_.set(0, o, d, t_max);
    accel_->shape_intersect(0, rays_, hits_);
    if (normal != nullptr) *normal = glm::normalize(Vec3(hits_.nx[0], hits_.ny[0], hits_.nz[0]));
    return hits_.t[0];
  }

  // A point of a random triangle, offset by its own rounding error to the side of `normal`: the shading point that a
  // renderer would make. With `either_side` the normal may be that of the triangle's back.
  struct ShadingPoint {
    Vec3 position, normal;
  };
  ShadingPoint shading_point(TestRandom& random, bool either_side) {
    const UVec3 t = mesh().triangles[random.index(uint32_t(mesh().triangles.size()))];
    const Vec3 a = mesh().positions[t.x], b = mesh().positions[t.y], c = mesh().positions[t.z];
    const float r = std::sqrt(random.uniform()), s = random.uniform();
    ShadingPoint result;
    result.normal = glm::normalize(glm::cross(b - a, c - a));
    if (either_side && random.uniform() < 0.5f) result.normal = -result.normal;
    result.position = a * (1.0f - r) + b * (r * (1.0f - s)) + c * (r * s);
    const Vec3 m = glm::max(glm::abs(a), glm::max(glm::abs(b), glm::abs(c)));
    result.position += result.normal * (gamma_bound(16) * (m.x + m.y + m.z));
    return result;
  }

 private:
  Scene scene_;
  std::unique_ptr<Accel> accel_;
  std::unique_ptr<Field> field_;
  std::unique_ptr<SingleRayQuery> probe_;
  RayBatch rays_;
  ShapeHits hits_;
};

}  // namespace fieldtrace
