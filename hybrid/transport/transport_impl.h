// The inside of TransportWorker: one wave of paths, stage by stage. transport.cpp holds the stages but for arrival
// (transport_arrive.cpp). Thread-safety: belongs to one thread.
#pragma once

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

#include "core/material/conductor_samples.h"
#include "core/sampling/sobol.hd.h"
#include "core/surface/surfaces.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/light/ambient_occlusion.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/transport/transport.h"

namespace fieldtrace {

// A sample stream separate from that of the lights, which use the vertex seeds unchanged.
inline constexpr uint32_t k_material_stream = 0x42534446u;

inline Vec2 sample_pair(uint32_t index, uint32_t seed, uint32_t dimension) {
  const auto p = scalar::sample_2d(index, seed, dimension);
  return {p.x, p.y};
}

inline float largest(const Rgb& c) { return std::max({c.x, c.y, c.z}); }

struct TransportWorker::Impl {
  const TransportContext& context;
  const Scene& scene;
  const TransportSettings& settings;
  Surfaces surfaces;
  DirectLight direct;
  AmbientOcclusion occlusion;
  Stats stats;

  RayBatch rays, next_rays;
  HitBatch hits;
  std::vector<PathState> paths, next_paths;
  // Between calls: what generate() made. Nothing changes these paths, so most members are still those of new ones.
  std::vector<PathState> camera_paths;
  // By camera ray. The three members of a camera path that differ from a new one's are set where a path is needed.
  SampleSeeds seeds;
  // By slot: another one for each pixel of the batch, and for each block of pixels that clusters span.
  AlignedVector<uint32_t> pixel_numbers, block_numbers;
  bool joins_pixels = false;  // clusters of first surfaces span such blocks
  const AlignedVector<uint32_t>& cluster_numbers() const { return joins_pixels ? block_numbers : pixel_numbers; }
  std::span<const uint32_t> sample_indices;
  std::vector<PixelPosition> pixels;  // of camera samples; empty where none are interpolated between
  TransportWorker::Cost sample_cost;
  std::vector<PathVertex> vertex_storage;  // never shrinks, because new vertices cost time
  std::span<PathVertex> vertices;
  std::vector<SurfacePoint> vertex_surfaces;
  std::vector<Material> resolved;  // of vertices on textured surfaces
  LobeSamples lobe_samples;
  LightReceivers receivers;
  std::vector<FirstHit> firsts;
  AlignedVector<float> near_distance;  // per camera ray
  LobeWorkspace lobe_work;
  std::vector<uint32_t> all_rays;
  std::vector<HitRun> runs, exact_runs;        // hits; those whose surface is looked up
  std::vector<const CertifiedHit*> certified;  // by ray; null: exact. Empty if all are
  std::span<Rgb> radiance;                     // by slot
  bool seeks_others = false;                   // diffuse surfaces send paths to instances that are not known there
  bool bodies_are_lit = false;                 // of plastics, by maps
  size_t showing = 0;                          // paths of this wave that pass smooth surfaces, for FirstHit
  bool bodies_end = false;                     // what these alone send on finds nothing more
  std::vector<Rgb> follow_radiance;

  explicit Impl(const TransportContext& c)
      : context(c),
        scene(c.scene),
        settings(c.settings),
        surfaces(c.scene, c.materials, c.settings.isa),
        direct(c),
        occlusion(c) {}

  // Whether diffuse surfaces of this number know what comes from those instances that send light by way of the sky.
  bool knows_indirect(int vertex_number) const { return context.indirect && context.has_sky_maps(vertex_number); }

  void begin(const CameraSamples& samples, std::span<Rgb> to);
  bool meet_first();  // whether light samples may be taken where the camera rays ended
  void leave_first();
  void end(uint64_t rays_before, double seconds);
  uint64_t rays_traced() const { return stats.rays_primary + stats.rays_exact; }
  void generate(const CameraSamples& samples);
  void number_pixels(const CameraSamples& samples);
  void pass_hidden_emitters();
  void intersect(int vertex_number);
  bool answers_lobes(int vertex_number) const;
  void record_reflections();
  void intersect_all(int vertex_number);
  LobeAnswerer::Request lobe_request() { return {rays, paths, hits, lobe_work, stats}; }
  void intersect_lobes();
  void take_lobes(int vertex_number);
  void begin_rays();
  void end_rays(int vertex_number);
  void intersect_by_hits();
  void mark_certified();
  void find_surfaces(bool only_emission);
  void arrive(int vertex_number);
  // What the rays that hit one instance share.
  struct MetInstance {
    uint32_t index = k_none, emitter = k_none, bsdf = 0;
    const Material *sides = nullptr, *diffuse_sides = nullptr;  // see MaterialTable
  };
  MetInstance met_instance(uint32_t index) const {
    const Instance& instance = scene.instances[index];
    return {index, instance.emitter, instance.bsdf, context.materials.sides(instance.bsdf),
            context.materials.diffuse_sides(instance.bsdf)};
  }
  // What arrive() knows about all paths of a wave.
  struct Arrival {
    int vertex_number = 0;
    bool is_first = false, emission_counts = false, shows_hits = false, last = false, diffuse_goes_on = false;
    uint32_t pixel_seed = 0, seed = scalar::vertex_seed(0, 0);  // of the path that was met last
    size_t vertices = 0;
    uint32_t seed_of(const PathState& path) {
      if (path.pixel_seed != pixel_seed) {
        pixel_seed = path.pixel_seed;
        seed = scalar::vertex_seed(pixel_seed, uint32_t(vertex_number));
      }
      return seed;
    }
  };
  PathState& arriving_path(const Arrival& arrival, uint32_t i);
  void meet_backgrounds(const Arrival& arrival, uint32_t begin, uint32_t end);
  void meet_emitter(const Arrival& arrival, const HitRun& run, uint32_t emitter);
  void meet_surface(Arrival& arrival, const HitRun& run, const MetInstance& instance);
  int side_of_all(const HitRun& run) const;
  void add_run(Arrival& arrival, const HitRun& run, const MetInstance& instance, int side);
  void add_vertex(Arrival& arrival, uint32_t i, const MetInstance& instance);
  void shade_vertex(const MetInstance& instance, const Vec3& d, float cos_geometric, bool diffuse_goes_on,
                    PathVertex& v);
  void record_first_hit(uint32_t path, const PathVertex& vertex);
  void show(uint32_t path, const PathVertex& vertex);
  void show_nothing();
  bool survives_roulette(PathState& path, uint32_t seed, int vertex_number) const;
  void add_emission(const PathState& path, const Rgb& throughput, const Vec3& origin, const Vec3& direction,
                    uint32_t light, const LightHit& hit);
  AmbientOcclusion::Request occlusion_request() { return {occlusion, pixels, firsts, stats}; }
  DirectLight::Request light_request(int vertex_number);
  void gather_light(int vertex_number);
  void add_light(int vertex_number);
  void scatter(int vertex_number);
  void go_on();
  bool goes_on(bool is_diffuse, int vertex_number) const;
  PathState leave(const PathVertex& vertex, int vertex_number) const;
  PathState& send(const PathVertex& vertex, const PathState& leaving, const Vec3& direction);
  void scatter_once(const PathVertex& vertex, const PathState& leaving, uint32_t index);
  void scatter_lobe(const PathVertex& vertex, const PathState& leaving, uint32_t first);
};

}  // namespace fieldtrace
