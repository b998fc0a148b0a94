// The seam between the shadow answerer and the machine that answers its questions about fields: `cpu`, or another
// device that has registered itself by name (gpu/).
//
// A device answers as the CPU's kernels do (field/query/segment_kernels.h), bit for bit, so that pictures do not depend
// on it. It reads a field's cells and tiles from a copy of its own; what that lacks, and what the device cannot answer
// for any reason, it has the CPU's kernels answer. Fields are baked by the CPU alone.
// Thread-safety: devices answer any number of threads at once; forget_fields() is called by one thread while no other
// asks, and devices are destroyed likewise. The list of kinds is written before main() and by tests alone.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/light/shading_points.h"
#include "core/platform/error.h"
#include "field/maps/cell_task.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"

namespace fieldtrace {

// What a device other than the CPU has done so far.
struct DeviceCounts {
  uint64_t blocks = 0;      // of k_batch_padding rays or shading points that it answered
  uint64_t blocks_cpu = 0;  // those that it left to the CPU: their cells were not resident, or it had failed
  uint64_t waves = 0;       // synchronisations with it
  uint64_t bytes_resident = 0, bytes_peak = 0;  // of its memory
};

class VisibilityDevice {
 public:
  virtual ~VisibilityDevice() = default;
  // As the functions of the same name in SegmentKernels. The task's field is `field`'s view. Once a field is gone,
  // forget_fields() comes before the next question. Rays that have a source may be made anew from it; `radius` and
  // `wanted` are then the same in all slots of a shading point, and `shading_point_instance` is the points'.
  virtual ConeCounts light_cones(const Field& field, const ConeTask&, const ShadingPointBatch&, const Sphere& light,
                                 std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns&) = 0;
  virtual uint64_t filter_strata(const Field& field, const StratumTask&, const RayBatch&, const LightRaySource& source,
                                 const float* pdf, const float* radius, const int32_t* wanted,
                                 std::span<const uint32_t> blocks, float* clear, int32_t* refused, ConeUnknowns&) = 0;
  // For the rays of all `blocks`, in ascending order.
  virtual SegmentCounts query(const Field& field, const SegmentTask&, const RayBatch&, const LightRaySource& source,
                              const uint32_t* shading_point_instance, std::span<const uint32_t> blocks,
                              int32_t candidate_slot, RayStates&) = 0;
  // What see_cell() (field/maps/cell_visibility.hd.h) of all tasks, in order, leaves in `sums` that were 0; and for
  // each k_batch_padding points, a multiple of which there must be, a mask of those for which a task is undecided:
  // undecided[block * tasks.size() + task]. Maps and radiance that tasks refer to stay as they are until
  // forget_fields(). False: nothing was done, and see_cell() must do it.
  virtual bool see_cells(std::span<const CellTask>, const CellPoints&, const CellSums&, std::span<uint32_t>) {
    return false;
  }
  // Drops all copies of fields, and says what has gone wrong meanwhile.
  virtual void forget_fields() {}
  virtual DeviceCounts counts() const { return {}; }
};

// The CPU: its kernels.
class CpuDevice : public VisibilityDevice {
 public:
  explicit CpuDevice(const SegmentKernels& kernels) : kernels_(kernels) {}

  ConeCounts light_cones(const Field&, const ConeTask& task, const ShadingPointBatch& points, const Sphere& light,
                         std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns& unknowns) override {
    return kernels_.light_cones(task, points, light, blocks, flags, unknowns);
  }
  uint64_t filter_strata(const Field&, const StratumTask& task, const RayBatch& rays, const LightRaySource&,
                         const float* pdf, const float* radius, const int32_t* wanted, std::span<const uint32_t> blocks,
                         float* clear, int32_t* refused, ConeUnknowns& unknowns) override {
    return kernels_.filter_strata(task, rays, pdf, radius, wanted, blocks, clear, refused, unknowns);
  }
  SegmentCounts query(const Field&, const SegmentTask& task, const RayBatch& rays, const LightRaySource& source,
                      const uint32_t* shading_point_instance, std::span<const uint32_t> blocks, int32_t candidate_slot,
                      RayStates& states) override;

 private:
  const SegmentKernels& kernels_;
};

struct DeviceOptions {
  const SegmentKernels& kernels;  // the CPU's, for what the device leaves
  uint64_t memory = 0;            // bytes that it may allocate; 0: as much as it has
  WarningSink warning;            // called by forget_fields() and when the device is destroyed
};

struct DeviceKind {
  std::string name;
  // What this build lacks for it, as part of a sentence; empty: nothing.
  std::string lacks;
  // The machine's devices of this kind, a line each; or a line that says why there are none.
  std::function<std::vector<std::string>()> list;
  // Throws Error where the machine has no such device, or it cannot be used.
  std::function<std::unique_ptr<VisibilityDevice>(const DeviceOptions&)> open;
};

// Replaces a kind of the same name. Returns true.
bool register_device_kind(DeviceKind kind);
// Those registered, in the order of their names; the CPU is not among them.
std::vector<DeviceKind> device_kinds();
// Throws UsageError if the kind is not registered, or if this build lacks something for it.
DeviceKind device_kind(const std::string& name);

// The device of that name; null for `cpu`. Where it cannot be opened a warning says why and that the CPU answers, and
// it is null, too. Throws UsageError as device_kind() does.
std::unique_ptr<VisibilityDevice> open_device(const std::string& name, const DeviceOptions& options);

}  // namespace fieldtrace
