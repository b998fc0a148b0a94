// Hits and shadows by Embree: the reference.
#include <numeric>

#include "core/surface/surface.h"
#include "tools/thesis/tracer.h"

namespace fieldtrace {
namespace {

class ExactTracer final : public PhongTracer {
 public:
  ExactTracer(const PhongScene& scene, const Accel& accel) : scene_(scene.geometry), accel_(accel) {}

  void nearest(TracerBatch& batch, bool primary) const override {
    const size_t count = batch.rays.size;
    batch.exact_hits.resize(count);
    accel_.intersect(batch.rays, batch.exact_hits, primary ? Coherence::coherent : Coherence::incoherent);
    batch.surfaces.resize(count);
    for (size_t i = 0; i < count; ++i) {
      PhongSurface& s = batch.surfaces[i];
      s.instance = batch.exact_hits.instance[i];
      if (s.instance == k_none) continue;
      const SurfacePoint p = surface_at(scene_, batch.rays, batch.exact_hits, i);
      // Both sides of a surface are visible, as in a field.
      const bool behind = glm::dot(p.geometric_normal, batch.rays.direction(i)) > 0.0f;
      const bool opposed = glm::dot(p.geometric_normal, p.shading_normal) < 0.0f;
      s.position = p.position;
      s.geometric = behind ? -p.geometric_normal : p.geometric_normal;
      s.normal = behind != opposed ? -p.shading_normal : p.shading_normal;
      s.error = p.error;
    }
  }

  void shadow(TracerBatch& batch, const Vec3& light) const override {
    const size_t count = batch.shading_points.size();
    batch.shadow_rays.resize(count);
    batch.indices.resize(count);
    std::iota(batch.indices.begin(), batch.indices.end(), 0u);
    for (size_t k = 0; k < count; ++k) {
      const PhongSurface& s = batch.surfaces[batch.shading_points[k]];
      const Vec3 o = offset_origin(s.position, s.geometric, s.error, light - s.position);
      batch.shadow_rays.set(k, o, light - o, 1.0f);
    }
    batch.blocked.assign(padded(count), 0);
    accel_.occluded(batch.shadow_rays, batch.indices, batch.blocked.data());
    batch.hidden.assign(padded(count), 0u);
    for (size_t k = 0; k < count; ++k) batch.hidden[k] = batch.blocked[k];
  }

 private:
  const Scene& scene_;
  const Accel& accel_;
};

}  // namespace

std::unique_ptr<PhongTracer> make_exact_tracer(const PhongScene& scene, const Accel& accel) {
  return std::make_unique<ExactTracer>(scene, accel);
}

}  // namespace fieldtrace
