// What the workers of one picture's light transport share, and the interface by which they trace paths for each other.
//
// Thread-safety: a TransportContext is const once it is set up, and shared.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/camera/camera.h"
#include "core/light/light_sampling.h"
#include "core/material/material_table.h"
#include "core/simd/isa.h"
#include "core/trace/accel.h"
#include "hybrid/path/path_batch.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {

struct TransportSettings {
  int light_samples = 1;  // shadow rays per light at a camera path's first surface; later ones send one
  // The same where something may hide the light, if that is more and the light is no sky.
  int open_light_samples = 1;
  int open_sun_samples = 1;  // of suns that are cut out of a sky that maps answer for
  int pixel_samples = 1;     // camera samples of a pixel in one wave, as expected: its shading points form clusters
  int lobe_samples = 1;      // directions sampled at a camera path's first surface that is not diffuse
  int max_depth = -1;        // as IntegratorSettings
  int rr_depth = 5;
  bool hide_emitters = false;
  float tolerance = 0.0f;   // RenderOptions::tolerance
  bool estimates = false;   // irradiance once per cluster where it hardly varies, instead of once per vertex
  bool first_hits = false;  // keep what camera rays hit, for AOVs
  // Only with first_hits:
  bool count_first_hits = false;          // fill the shadow ray counts of FirstHit
  bool count_reflections = false;         // fill the glossy ray counts of FirstHit
  bool pass_smooth = false;               // fill what FirstHit shows beyond smooth surfaces
  bool occlusion = false;                 // fill the occlusion counts of FirstHit, with light_samples rays each
  float occlusion_distance = k_infinity;  // world units, > 0: what lies farther does not occlude
  uint32_t seed = 0;
  Isa isa = Isa::automatic;  // resolved
};

// Surfaces on one path, whatever max_depth is. Russian roulette ends a path with a probability of at least 5 % at each
// surface after rr_depth, so that with rr_depth = 5 only 1 path in 10^17 gets this far.
inline constexpr int k_longest_path = 768;

// Traces paths that begin at surfaces. Thread-safety: each thread has its own.
class PathFollower {
 public:
  virtual ~PathFollower() = default;

  // radiance[i] receives what leaves vertices[i] on the side that it was shaded from, without its own emission, by
  // light samples and by vertices[i].lobe_samples paths that continue from there. paths[i] gives the seeds and the
  // place in the sample sequence. `vertices` and `paths` are unspecified afterwards; what the vertices point to must
  // live until then. Values that are not finite count as black. Returns the number of rays traced. Unchecked: the
  // materials must let nothing pass straight through.
  virtual uint64_t follow(std::vector<PathVertex>& vertices, std::vector<PathState>& paths,
                          std::span<Rgb> radiance) = 0;
};

class HitAnswerer;
class LobeAnswerer;
class IndirectLight;
class Sky;

// Whether an area light is not sampled in closed form: paths find it, too. `lights`: those of the scene.
bool has_open_area(const Scene& scene, const LightTable& lights);

// Everything that workers share. All references must outlive it.
struct TransportContext {
  // `lights`: the scene's light table, if it exists already; null: it is made.
  TransportContext(const Scene& scene, const Accel& accel, const CameraSampler& camera, const ShadowAnswerer& answerer,
                   const TransportSettings& settings, std::shared_ptr<const LightTable> lights = nullptr);

  const Scene& scene;
  const Accel& accel;
  const CameraSampler& camera;
  const ShadowAnswerer& answerer;
  MaterialTable materials;
  const ShadowAnswerer* occlusion_answerer = &answerer;  // answers the rays of the layer `ao`
  const LobeAnswerer* lobes = nullptr;  // answers glossy rays by prefiltered radiance maps; null: none does
  const HitAnswerer* hits = nullptr;    // answers glossy rays by certified hits; null: all are traced
  const Sky* sky = nullptr;             // answers for the sky at diffuse first surfaces; null: light samples do
  // The instances that send diffuse light to such surfaces by way of `sky`; null: paths find all.
  const IndirectLight* indirect = nullptr;
  const Sky* occlusion_sky = nullptr;  // answers for the layer `ao`; null: rays do
  TransportSettings settings;
  std::shared_ptr<const LightTable> shared_lights;
  const LightTable& lights;
  std::vector<LightExtent> light_extents;  // where each light's rays end
  std::vector<uint8_t> closed_form;        // per light: sampled_in_closed_form
  std::vector<uint32_t> backgrounds;       // constant emitters and environment maps
  bool emission_can_be_hit = false;        // some emitter has an area or surrounds the scene
  bool area_can_be_hit = false;            // some emitter has an area
  bool open_form_can_be_hit = false;       // one of those is not sampled in closed form
  bool open_area_can_be_hit = false;       // has_open_area()
  // Whether `sky` gives all the light of the sky that diffuse surfaces of this number get from light samples.
  bool has_sky_maps(int vertex_number) const { return sky && vertex_number == 0; }
  // Whether fields and maps answer for whole pixels at once.
  bool has_fields() const { return sky || lobes || hits || settings.estimates; }
  // Whether irradiance is fitted within blocks of pixels (hybrid/light/pixel_blocks.h).
  bool fits_blocks() const { return sky || occlusion_sky; }
  // Whether clusters span blocks of k_cluster_side pixels: where nothing answers for whole clusters, they share no more
  // than the search for what may hide a light. What fields and maps answer for a cluster holds for one pixel.
  bool clusters_blocks() const { return !sky && !settings.estimates; }
  // Whether the pixels of blocks are traced together (tile_pixels() by blocks).
  bool traces_blocks() const { return fits_blocks() || clusters_blocks(); }
};

// Follows paths by `context`, which must outlive it (hybrid/transport/transport.cpp).
std::unique_ptr<PathFollower> make_path_follower(const TransportContext& context);

}  // namespace fieldtrace
