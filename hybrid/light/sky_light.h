// The light of the sky on diffuse surfaces, by direction cells: what is hidden of each cell is read from direction
// maps, once per cluster of shading points. Cells that maps leave undecided are rays. Where the light that objects send
// on is known (hybrid/sky/indirect_light.h), the same reads bring it.
//
// On even surfaces a few pixels of a block are asked for, and the others fitted to them (pixel_blocks.h).
//
// The irradiance is that of the open sky less what cells take from it. Undecided cells share rays in proportion to what
// they weigh, stratified over them; they alone bring noise, and each to one of a cluster's samples.
//
// A device is asked about the cells in sky_light_waves.cpp.
// Thread-safety: a SkyLight belongs to one thread.
#pragma once

#include <deque>
#include <functional>
#include <span>
#include <vector>

#include "field/maps/cell_kernels.h"
#include "field/maps/cell_tasks.h"
#include "hybrid/light/concentrated_light.h"
#include "hybrid/light/light_receivers.h"
#include "hybrid/light/pixel_blocks.h"
#include "hybrid/light/shading_clusters.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/sky/cell_occluders.h"
#include "hybrid/sky/enclosed_points.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {

class SkyLight {
 public:
  // `sky` may be null; gather() must not be called then.
  SkyLight(const TransportContext& context, const Sky* sky)
      : context_(context), sky_(sky), concentrated_(context, sky) {}

  // What gather() is given; the arguments as DirectLight::Request.
  struct Request {
    SkyLight& sky;
    const ShadingClusters& clusters;
    LightReceivers& receivers;
    std::span<const PathVertex> vertices;
    int light_samples = 1;
    std::span<const PixelPosition> pixels;
    std::span<FirstHit> firsts;
    Stats& stats;
  };
  // Adds what the plainly diffuse ones of the clusters and the bodies of plastics reflect of the sky's light.
  static void gather(const Request& request);
  // The same for several requests, in parallel, which ask `device` about their cells in waves; the CPU's kernels answer
  // what it leaves.
  static void gather_waves(std::span<const Request> requests, VisibilityDevice& device);

 private:
  // A sample stream separate from that of the lights, which use the vertex seeds unchanged.
  static constexpr uint32_t k_sky_stream = 0x534b5900u;

  struct Job {
    LightReceivers& receivers;
    int light_samples;
    std::span<FirstHit> firsts;
    Stats& stats;
    std::span<const ShadingCluster> clusters = {};  // of one instance; centres_ holds their centres
    std::span<const uint32_t> numbers = {};         // of these
    Sphere place = {};                              // SkyMaps::place() of all of them
  };
  // A cell that is undecided for a point of the batch, and its weight there.
  struct OpenCell {
    uint32_t point, cell;
    float weight;
  };
  // A batch whose cells a device is asked about.
  struct AskedBatch {
    std::vector<ShadingCluster> clusters;
    std::vector<uint32_t> numbers;
    Sphere place;
    float grazing = 0.0f;
    ShadingPointBatch centres;
    CellTasks tasks;
    std::vector<uint32_t> cells;  // of these, as OpenCell::cell
    SkyQuestion question;
  };
  // A ray towards an open cell: its part of the irradiance for a radiance of 1.
  struct CellRay {
    uint32_t point, receiver;
    float weight;
  };

  void choose_points(const ShadingClusters& clusters, LightReceivers& receivers, std::span<const PathVertex> vertices);
  float light_bodies(const ShadingCluster& cluster, std::span<const PathVertex> vertices,
                     LightReceivers& receivers) const;
  void find_blocks(const LightReceivers& receivers, std::span<const PixelPosition> pixels);
  void begin(const Request& request);
  Job job_of(const Request& request) const;
  // What is asked for after a round: nothing once all is known.
  void refine(const Request& request);
  void finish(const Request& request);
  // Calls f(job) for batches of the clusters of these numbers, of one instance and place each.
  void for_batches(Job job, std::span<const uint32_t> numbers, const std::function<void(const Job&)>& f);
  void begin_batch();
  void see_batch(const Job& job);
  CellSums clear_sums();
  void see_cells(const Job& job);
  void finish_batch(const Job& job);
  // The same by a device: asks about the cells of all batches that are wanted, and takes the answers.
  void ask_cells(const Request& request);
  void take_cells(const Request& request);
  void take_answers(const AskedBatch& batch, const Job& job);
  void add_open_cell(const CellTask& task, uint32_t cell, uint32_t point);
  void sort_open_cells();
  void sample_open_cells(const Job& job);
  static uint32_t receiver_of_ray(const Job& job, size_t point, float at);
  size_t start_of_ray(const Job& job, size_t point, float at) const;
  // Of a ray along d from point i.
  static Vec3 ray_origin(const ShadingPointBatch& points, size_t i, const Vec3& d);
  void sample_cells_of(const Job& job, std::span<const OpenCell> cells);
  void trace(const Job& job);
  void add_rays();
  void keep_arrivals(const Job& job);
  void add_irradiance(const Job& job);
  // A direction in a cell; x and y in [0, 1].
  Vec3 direction_in(uint32_t cell, float x, float y) const;
  // For --check (sky_light_checks.cpp): compares some points' decided cells, what arrives there, and what was fitted,
  // with rays.
  void check_cells(const Job& job);
  void check_shares(const Job& job, size_t point);
  void check_arrival(const Job& job, size_t point);
  void check_fitted(const Job& job);

  const TransportContext& context_;
  const Sky* sky_;
  ConcentratedLight concentrated_;
  CellOccluders occluders_;
  Mat3 grid_ = Mat3(1.0f);
  const SkyCells* light_ = nullptr;       // of the batch's instance
  float grazing_ = 0.0f;                  // of the batch
  std::vector<ShadingCluster> clusters_;  // those to light, in parts where they are wide
  ShadingPointBatch points_;              // what stands for each
  std::vector<float> grazing_of_;         // CellPoints::grazing of these
  std::vector<uint32_t> own_points_;      // receivers at which these are lit; k_none: at a cluster's centre
  std::vector<Sphere> places_;            // of these
  std::vector<Rgb> open_irradiance_;      // of these, of the open sky
  std::vector<SkyArrival> arrivals_;      // at these
  std::vector<uint8_t> fitted_;           // whether these were fitted
  std::vector<uint32_t> traced_;          // rays of these
  std::vector<Rgb> by_rays_;              // irradiance that rays bring, by receiver
  float unit_ = 1.0f;                     // of arrivals_'s irradiance of what objects send on
  PixelBlocks blocks_;
  std::vector<PixelPosition> pixels_;      // of these, for blocks_
  std::vector<uint32_t> groups_, wanted_;  // likewise
  std::vector<uint32_t> order_;            // of those of for_batches(), by instance and place
  struct Run {
    uint32_t begin, end;
  };
  std::vector<Run> runs_;  // neighbours among these that have both in common
  std::vector<ShadingCluster> batch_;
  ShadingPointBatch centres_;
  AlignedVector<float> red_, green_, blue_;  // of the cells' sums, then the irradiance of the sky
  AlignedVector<float> reflected_red_, reflected_green_, reflected_blue_;  // irradiance of what objects send back
  std::vector<float> open_;  // luminance of the open sky's irradiance, by point
  EnclosedPoints enclosed_;
  CellScratch cell_scratch_;
  std::deque<AskedBatch> asked_;
  std::vector<OpenCell> open_cells_, sorted_cells_;
  std::vector<uint32_t> open_begin_;
  std::vector<float> weight_sums_;
  std::vector<CellRay> cell_rays_;
  std::vector<uint32_t> ray_counts_;  // by point
  RayBatch rays_;
  std::vector<uint32_t> ray_indices_;
  std::vector<uint8_t> blocked_;
  HitBatch hits_;
};

}  // namespace fieldtrace
