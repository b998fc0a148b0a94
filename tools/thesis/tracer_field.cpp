// Hits and shadows from fields alone.
#include <algorithm>

#include "field/thesis/thesis_kernels.h"
#include "tools/thesis/tracer.h"

namespace fieldtrace {
namespace {

class FieldTracer final : public PhongTracer {
 public:
  FieldTracer(const PhongScene& scene, const std::vector<const ThesisField*>& fields, Isa isa)
      : kernels_(thesis_kernels(resolve_isa(isa))) {
    const auto& instances = scene.geometry.instances;
    for (uint32_t i = 0; i < instances.size(); ++i) {
      views_.push_back(thesis_instance_view(*fields[instances[i].shape], instances[i], i));
    }
  }

  void nearest(TracerBatch& batch, bool) const override {
    ThesisHits& hits = batch.field_hits;
    const size_t count = batch.rays.size;
    hits.resize(count);
    std::fill(hits.t.begin(), hits.t.end(), k_infinity);
    std::fill(hits.instance.begin(), hits.instance.end(), k_none);
    for (const ThesisInstanceView& view : views_) kernels_.nearest(view, batch.rays, batch.skip, hits);
    batch.surfaces.resize(count);
    for (size_t i = 0; i < count; ++i) {
      PhongSurface& s = batch.surfaces[i];
      s.instance = hits.instance[i];
      if (s.instance == k_none) continue;
      s.position = batch.rays.origin(i) + batch.rays.direction(i) * hits.t[i];
      s.normal = s.geometric = {hits.nx[i], hits.ny[i], hits.nz[i]};
    }
  }

  // Section 3.2.3: one look-up from the light towards the point finds what the light sees first.
  void shadow(TracerBatch& batch, const Vec3& light) const override {
    const size_t count = batch.shading_points.size();
    batch.shadow_rays.resize(count);
    for (size_t k = 0; k < count; ++k) {
      const Vec3& p = batch.surfaces[batch.shading_points[k]].position;
      batch.shadow_rays.set(k, p, light - p, 1.0f);
    }
    batch.states.reset(count);
    for (const ThesisInstanceView& view : views_) {
      kernels_.shadow(view, batch.shadow_rays, 0, padded(count), 0, batch.states);
    }
    batch.hidden.resize(padded(count));
    for (size_t k = 0; k < count; ++k) batch.hidden[k] = (batch.states.state[k] & RayStates::k_blocked) != 0;
  }

 private:
  const ThesisKernels& kernels_;
  std::vector<ThesisInstanceView> views_;
};

}  // namespace

std::unique_ptr<PhongTracer> make_field_tracer(const PhongScene& scene, const std::vector<const ThesisField*>& fields,
                                               Isa isa) {
  return std::make_unique<FieldTracer>(scene, fields, isa);
}

}  // namespace fieldtrace
