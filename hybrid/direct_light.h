// Direct light at a wave of path vertices: samples every light, has the shadow rays answered, adds up what arrives.
//
// Batches of about k_shadow_batch rays stay in the second-level cache between the three steps.
// Thread-safety: a DirectLight belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "hybrid/aovs.h"
#include "hybrid/halves.h"
#include "hybrid/path_batch.h"
#include "hybrid/reflected_light.h"
#include "hybrid/transport.h"

namespace fieldtrace {

inline constexpr int k_shadow_batch = 8192;

// A part of a batch with too many objects about it is halved if its receivers send this many rays each to a light, and
// the part more than that many: with fewer, searching costs more than is saved (docs/decisions/010-crowds.md).
inline constexpr int k_fewest_halving_samples = 16;
inline constexpr int k_smallest_part_rays = 512;

// How many samples of each receiver are answered first, where whole lights may be answered at once: if they all agree,
// the rest is taken to agree too. The smallest divisor of light_samples from 2 sqrt(light_samples) on: a penumbra then
// gets about an eighth more variance, whatever the number of samples (docs/decisions/009-cones.md). 0: none.
int first_light_samples(int light_samples);

class DirectLight {
 public:
  explicit DirectLight(const TransportContext& context) : context_(context) {}

  // arriving[i] = radiance reflected towards the path by vertex i, path throughput not included. Delta materials
  // receive none. `firsts`, if not empty, is indexed by the path's slot and receives the counts of shadow rays.
  void gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
              std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats);

 private:
  // What gather() was given, and the light that it is at.
  struct Job {
    std::span<const PathVertex> vertices;
    std::span<const PathState> paths;
    int light_samples = 1;
    std::span<FirstHit> firsts;
    std::span<Rgb> arriving;
    Stats& stats;
    uint32_t light = 0;
  };
  // A part of lit_, [begin, end).
  struct Part {
    size_t begin = 0, end = 0;
  };

  // Lights one part by one light. Leaves it undone, and its halves in parts_, if halve() says so.
  void gather_part(const Job& job, const Part& part);
  // Sorts places_ into those that some object may shadow, those that nothing can, and those that see nothing of the
  // light.
  void split_receivers(const Job& job);
  // Where candidates_ are too many for the part and halves may have fewer: pushes the halves onto parts_, true.
  bool halve(const Job& job, const Part& part);
  // For --check: traces what split_receivers() took for certain.
  void check_split(const Job& job);
  // Has the first samples of shadowed_ answered. Where they agree the receiver goes to free_ or dark_; else they are
  // added up, and the receiver stays for the other samples.
  void ask_first_samples(const Job& job, int count);
  // Samples of group_ answered and added up; free receivers' without asking.
  void gather_samples(const Job& job, const LightSampleRange& range);
  void gather_free(const Job& job);
  // For the layers: counts the rays of receivers that see nothing of the light.
  void count_dark(const Job& job);

  // Fills places_ for a part, unless they are there already.
  void place_receivers(const Job& job, const Part& part);
  const PathVertex& vertex_of(const Job& job, uint32_t place) const {
    return job.vertices[lit_[places_part_.begin + place]];
  }
  static LightSampleRange all_samples(const Job& job) { return {job.light_samples, 0, job.light_samples}; }
  void sample_group(const Job& job, const LightSampleRange& range);
  LightEstimate estimate_of(const Job& job) const;
  // Adds up and counts the rays of receiver r of group_, `samples` of them; and of all of group_.
  void add_receiver(const Job& job, const LightEstimate& light, size_t r, int samples);
  void add_group(const Job& job, int samples);

  const TransportContext& context_;
  ReceiverBatch receivers_;  // group_
  ShadowBatch shadows_;
  std::vector<uint32_t> lit_;  // vertices that take light samples
  ReceiverBatch places_;       // the current part of them
  Part places_part_;
  // Of these, as indices into places_: those of the current batch, and how split_receivers() sorted them.
  std::vector<uint32_t> group_, shadowed_, free_, dark_;
  ShadowGroup candidates_;
  std::vector<Part> parts_;  // of the batch, not lit yet by the current light
  bool in_halves_ = false;   // the batch's part of lit_ is in the order of order_by_halves
  std::vector<PlacedIndex> placed_;
};

}  // namespace fieldtrace
