#include "hybrid/path/transport_context.h"

namespace fieldtrace {
namespace {

bool can_be_hit(EmitterKind kind) { return kind == EmitterKind::area || is_sky(kind); }

// Whether rays from materials are to look for the light. Black ones send none.
bool is_open(const Light& light) { return light.kind != LightKind::none && !sampled_in_closed_form(light); }

}  // namespace

bool has_open_area(const Scene& scene, const LightTable& lights) {
  for (size_t i = 0; i < scene.emitters.size(); ++i) {
    if (scene.emitters[i].kind == EmitterKind::area && is_open(lights.lights[i])) return true;
  }
  return false;
}

TransportContext::TransportContext(const Scene& s, const Accel& a, const CameraSampler& c, const ShadowAnswerer& sa,
                                   const TransportSettings& ts, std::shared_ptr<const LightTable> made)
    : scene(s),
      accel(a),
      camera(c),
      answerer(sa),
      materials(s),
      settings(ts),
      shared_lights(made ? std::move(made) : std::make_shared<const LightTable>(make_lights(s))),
      lights(*shared_lights) {
  if (!settings.first_hits) {
    settings.count_first_hits = settings.count_reflections = settings.occlusion = settings.pass_smooth = false;
  }
  for (uint32_t i = 0; i < s.emitters.size(); ++i) {
    const Emitter& emitter = s.emitters[i];
    light_extents.push_back(light_extent(s, i));
    closed_form.push_back(sampled_in_closed_form(lights.lights[i]));
    if (is_sky(emitter.kind)) backgrounds.push_back(i);
    emission_can_be_hit |= can_be_hit(emitter.kind);
    area_can_be_hit |= emitter.kind == EmitterKind::area;
    open_form_can_be_hit |= can_be_hit(emitter.kind) && is_open(lights.lights[i]);
  }
  open_area_can_be_hit = has_open_area(s, lights);
}

}  // namespace fieldtrace
