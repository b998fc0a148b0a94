// The seam between the shadow answerer and the machine that answers its questions about fields: `cpu`, or another
// device that has registered itself by name (gpu/).
//
// Questions go to a device in waves: those of one level of light visibility for a band of many tiles, each about one
// occluder. Rays and shading points that several questions name are the same arrays, so that a device takes them once
// a wave. Answers are the CPU's kernels' (field/query/segment_kernels.h), bit for bit, so that pictures do not depend
// on the device; device_answers.h merges them. What a device leaves - it reads fields from a copy of its own, and may
// fail at any time - those kernels answer. Fields are baked by the CPU alone.
// Thread-safety: devices answer any number of threads at once; forget_fields() is called by one thread while no other
// asks, and devices are destroyed likewise. The list of kinds is written before main() and by tests alone.
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/light/shading_points.h"
#include "core/platform/error.h"
#include "field/maps/cell_tasks.h"
#include "field/query/answer_masks.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"

namespace fieldtrace {

// A question about one field; what it refers to stays as it is until it is answered.
struct DeviceQuestion {
  const Field* field = nullptr;  // whose view is the task's; null: nothing is asked, or it is about radiance maps
  // Of k_batch_padding entries, by their first ones, ascending; and for each a mask of the entries that are meant.
  std::vector<uint32_t> blocks, wanted;
  uint64_t samples = 0;      // light samples, strata or rays that the entries stand for
  bool is_answered = false;  // the answers are there, a mask for each block
  // What the blocks that were left met that is not baked, as far as it was named, with repeats. Once it is baked the
  // question may be asked again: then these blocks are.
  struct Unbaked {
    std::vector<uint32_t> visibility, depth, tiles;  // slices of two layers, coverage tiles
    bool empty() const { return visibility.empty() && depth.empty() && tiles.empty(); }
  } unbaked;
};

// Whether a ball of light is seen from shading points.
struct ConeQuestion : DeviceQuestion {
  ConeTask task;
  const ShadingPointBatch* points = nullptr;
  Sphere light;
  std::vector<ConeMasks> masks;
};

// The share of strata that the object leaves clear. Rays that have a source may be made anew from it.
struct StratumQuestion : DeviceQuestion {
  StratumTask task;
  const ShadowBatch* batch = nullptr;  // its rays, densities and source
  const float* radius = nullptr;       // by ray; where the rays have a source, those of its points
  std::vector<ShareMasks> masks;
  std::vector<float> clear;  // by entry of the blocks
};

// What the field knows about single rays.
struct RayQuestion : DeviceQuestion {
  SegmentTask task;
  const ShadowBatch* batch = nullptr;  // its rays, instances and source
  std::vector<RayMasks> masks;
};

// The radiance that an object with radiance maps sends along samples of reflected lobes.
struct LobeQuestion : DeviceQuestion {
  ConeTask task;
  const CoverageTiles* tiles = nullptr;  // whose view is the task's
  const LobeBatch* batch = nullptr;
  std::vector<ShareMasks> masks;
  // By entry of the blocks; of all one after another: clear, red, green, blue, distance, as LobeAnswers.
  std::vector<float> values;
};
inline constexpr size_t k_lobe_values = 5;

// What see_cell() (field/maps/cell_visibility.hd.h) of all tasks, in order, leaves in sums that were 0; and for each
// k_batch_padding points, a multiple of which there must be, a mask of those for which a task is undecided:
// undecided[block * number of tasks + task]. Maps and radiance that tasks refer to stay as they are until
// forget_fields().
struct SkyQuestion {
  const CellTasks* tasks = nullptr;
  CellPoints points = {};
  bool is_answered = false;
  std::vector<float> sums = {};  // red, green, blue, and the reflected ones: those of all points one after another
  std::vector<uint32_t> undecided = {};
};

struct DeviceWave {
  std::vector<ConeQuestion*> cones;
  std::vector<StratumQuestion*> strata;
  std::vector<RayQuestion*> rays;
  std::vector<LobeQuestion*> lobes;
  std::vector<SkyQuestion*> skies;
  bool empty() const { return cones.empty() && strata.empty() && rays.empty() && lobes.empty() && skies.empty(); }
};

// What a device other than the CPU has done so far.
struct DeviceCounts {
  uint64_t blocks = 0;      // of k_batch_padding rays, lobe samples or shading points that it answered
  uint64_t blocks_cpu = 0;  // those that were left to the CPU: their cells were not resident, or it had failed
  uint64_t waves = 0;       // synchronisations with it
  uint64_t samples = 0;     // that all questions stood for (DeviceQuestion::samples), and cells of skies for each point
  uint64_t waves_full = 0;  // waves of at least k_wave_samples samples
  uint64_t bytes_resident = 0, bytes_peak = 0;  // of its memory
};

// Light samples that a wave is made from, if the picture has as many.
inline constexpr uint64_t k_wave_samples = 131072;

class VisibilityDevice {
 public:
  virtual ~VisibilityDevice() = default;
  // Answers what it can, and returns when that is done. Once a field is gone, forget_fields() comes before the next
  // wave.
  virtual void answer(const DeviceWave& wave) = 0;
  // Drops all copies of fields, and says what has gone wrong meanwhile.
  virtual void forget_fields() {}
  virtual DeviceCounts counts() const { return {}; }
};

struct DeviceOptions {
  uint64_t memory = 0;  // bytes that it may allocate; 0: as much as it has
  WarningSink warning;  // called by forget_fields() and when the device is destroyed
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

// A device that a thread of its own opens, since that takes longer than many a frame. Where it cannot be opened a
// warning says why and that the CPU answers.
// Thread-safety: one thread at a time.
class OpeningDevice {
 public:
  // `name`: of a registered kind, or `cpu`. Throws UsageError as device_kind() does.
  OpeningDevice(const std::string& name, const DeviceOptions& options);
  // Waits until it is open; null: the CPU answers.
  VisibilityDevice* get();
  // What get() has returned; null before.
  VisibilityDevice* in_use() const { return device_.get(); }

 private:
  const std::string name_;
  const WarningSink warning_;
  std::future<std::unique_ptr<VisibilityDevice>> opening_;
  std::unique_ptr<VisibilityDevice> device_;
};

}  // namespace fieldtrace
