// The arrays that questions of a wave share: shading points, and rays, which the device makes from shading points where
// they are samples of a light; and samples of lobes. Each batch is sent once a wave, however many occluders it is asked
// about.
//
// Memory layout: structures of arrays; batches lie one after another, each padded to whole blocks of 32 entries.
// Thread-safety: those of one wave belong to one thread.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/light/shading_points.h"
#include "field/query/segment_kernels.h"
#include "gpu/device_arguments.h"
#include "gpu/device_memory.h"

namespace fieldtrace::gpu {

// A table that is copied to the device once.
struct HostTable {
  const void* host;
  size_t bytes;
};

// Tables in device memory by their addresses on the host; without memory: those that there was no room for.
struct DeviceTables {
  std::map<const void*, DeviceBuffer> buffers;
  template <class T>
  T* at(const void* host) const {
    return buffers.at(host).as<T>();
  }
};

class WavePoints {
 public:
  // What is read of the points: positions, geometric normals, errors, radii and instances; or what light samples take,
  // too.
  enum class Use { cones, light_samples };
  explicit WavePoints(Use use) : use_(use) {}

  void clear();
  // The place of the batch's first point: a multiple of 32, the same each time. The batch stays until stage().
  uint32_t add(const ShadingPointBatch& batch);
  void stage(StagingBuffer& in);
  PointArrays for_cones(const StagingBuffer& in) const;
  ReceiverArrays for_light_samples(const StagingBuffer& in) const;

 private:
  template <class T>
  size_t stage_array(StagingBuffer& in, const AlignedVector<T> ShadingPointBatch::*array) const;
  size_t stage_transmits(StagingBuffer& in) const;

  const Use use_;
  std::vector<std::pair<const ShadingPointBatch*, uint32_t>> batches_;
  std::map<const ShadingPointBatch*, uint32_t> places_;
  uint32_t size_ = 0;
  size_t floats_at_[11] = {}, words_at_[3] = {}, transmits_at_ = 0;  // in the orders of ReceiverArrays
};

class WaveRays {
 public:
  // Where a batch's rays are: entry i of it is entry first + i of arrays().
  struct Place {
    size_t set = 0;  // of arrays: k_made, or the batch's own
    uint32_t first = 0;
  };
  static constexpr size_t k_made = 0;

  void clear();
  // The rays of `batch` are made on the device if they have a source, and sent otherwise, with densities and with
  // `radius` if that is not null, and with instances. The batch and what it refers to stay until stage().
  Place add(const ShadowBatch& batch, const float* radius, WavePoints& points);
  // The tables that making those of a source takes.
  static void list_tables(const LightRaySource& source, std::vector<HostTable>& tables);
  // Makes room. Places are those that add() returns again from now on.
  void stage(StagingBuffer& in, StagingBuffer& made);
  // Starts the kernels that make rays.
  void start(Runtime& runtime, Stream stream, const StagingBuffer& in, const StagingBuffer& made,
             const WavePoints& points, const DeviceTables& tables) const;

  RayArrays arrays(size_t set, const StagingBuffer& in, const StagingBuffer& made) const;
  const float* pdf(size_t set, const StagingBuffer& in, const StagingBuffer& made) const;
  const float* radius(size_t set, const StagingBuffer& in, const StagingBuffer& made) const;
  const uint32_t* instance(size_t set, const StagingBuffer& in, const StagingBuffer& made) const;

 private:
  struct Batch {
    Place place;
    uint32_t point = 0;  // the place of its source's first shading point
  };
  // Rays that one launch makes: of one light, in the same number and way.
  struct Making {
    LightRaySource source;  // but for its points and slots
    bool any_transmits = false, by_number = false;
    std::vector<const ShadowBatch*> batches = {};
    uint32_t first = 0, warps = 0;
    size_t blocks_at = 0, numbers_at = 0;
  };
  // Arrays that are sent, or made.
  struct Set {
    const ShadowBatch* batch = nullptr;
    const float* host_radius = nullptr;
    size_t at[7] = {}, pdf_at = 0, radius_at = 0, instance_at = 0;
  };

  void stage_making(Making& making, uint32_t first, StagingBuffer& in);
  template <class T>
  const T* place(size_t set, size_t at, const StagingBuffer& in, const StagingBuffer& made) const {
    return set == k_made ? made.device<const T>(at) : in.device<const T>(at);
  }

  std::map<const ShadowBatch*, Batch> batches_;
  std::map<std::string, size_t> making_of_;
  std::vector<Making> makings_;
  std::vector<Set> sets_ = std::vector<Set>(1);
};

// Samples of lobes, which are sent.
class WaveLobes {
 public:
  void clear();
  // As WavePoints::add().
  uint32_t add(const LobeBatch& batch);
  void stage(StagingBuffer& in);
  LobeArrays arrays(const StagingBuffer& in) const;

 private:
  std::vector<std::pair<const LobeBatch*, uint32_t>> batches_;
  std::map<const LobeBatch*, uint32_t> places_;
  uint32_t size_ = 0;
  size_t floats_at_[12] = {}, instance_at_ = 0;  // in the order of LobeArrays
};

}  // namespace fieldtrace::gpu
