// A scene of the library: what was set, what was committed, and what answers queries.
//
// Thread-safety: queries and bakes hold `mutex` shared, changes hold it alone. Fields grow under queries.
#pragma once

#include <atomic>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <vector>

#include "core/platform/ticker.h"
#include "core/scene/scene.h"
#include "core/trace/accel.h"
#include "field/bake/slice_demand.h"
#include "field/store/field.h"
#include "hybrid/api/api_objects.h"
#include "hybrid/api/ray_kernels.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/render/render.h"
#include "hybrid/sky/sky.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace::api {

// Shares of queries that needed no exact ray.
struct AnswerCounts {
  std::atomic<uint64_t> rays = 0, certified = 0;
  void add(uint64_t all, uint64_t decided) {
    rays.fetch_add(all, std::memory_order_relaxed);
    certified.fetch_add(decided, std::memory_order_relaxed);
  }
  double share() const { return rays == 0 ? 0.0 : double(certified) / double(rays); }
};

// A shared mutex whose changes get their turn, which those of std::shared_mutex may wait for without end while threads
// keep asking. Not recursive, not even shared: a change that waits holds up whoever comes after it.
class TurnMutex {
 public:
  void lock() {
    const std::lock_guard turn(turn_);
    mutex_.lock();
  }
  void unlock() { mutex_.unlock(); }
  void lock_shared() {
    const std::lock_guard turn(turn_);
    mutex_.lock_shared();
  }
  void unlock_shared() { mutex_.unlock_shared(); }

 private:
  std::mutex turn_;
  std::shared_mutex mutex_;
};

// Throws Error for a scene of lengths that single precision cannot hold (core/loader/scene_limits.h).
void check_limits(const Scene& scene);

struct SceneObject {
  explicit SceneObject(std::shared_ptr<Device> of) : device(std::move(of)) {}

  // With `mutex` held alone. Throws Error if Embree or the system refuses.
  void commit();
  // Throws Failure before the first commit. With `mutex` held.
  void require_commit(const char* function) const;
  // Null for numbers that are no mesh's: Failure. Before the first commit, or without a field: null.
  Field* field_of(uint32_t mesh) const;
  // Moves the camera's clipping planes so that they clip nothing of the scene as committed, if `fits_clips`.
  void fit_clips();
  // Parts of commit().
  void prepare();
  void make_fields();

  std::shared_ptr<Device> device;
  mutable TurnMutex mutex;
  Scene scene;  // as committed, but for instances
  RenderOptions options;
  FieldParameters parameters;
  float largest_coordinate = 0.0f;  // of what queries may name
  UsualSquares usual;               // of their directions
  // Set since the last commit, by instance.
  std::vector<Affine> transforms;
  std::map<uint32_t, uint32_t> own_bsdfs;  // that ftSetInstanceReflectance() made, by instance
  bool fits_clips = false;                 // the camera's clipping planes follow the scene
  bool was_committed = false;
  std::optional<float> tolerance;  // as committed
  float base_tolerance() const { return tolerance.value_or(k_default_tolerance); }

  // Made by commit(); references go upwards.
  std::vector<ShapeTraits> traits;
  std::optional<FieldSet> fields;
  std::vector<std::unique_ptr<SliceDemand>> demands;  // by shape
  std::unique_ptr<Accel> accel;
  std::unique_ptr<ShadowAnswerer> shadows;
  std::unique_ptr<HitAnswerer> hits;
  std::vector<Field*> hit_fields;
  std::vector<uint8_t> has_certified_hits;  // by instance: `hits` asks its field

  // Made by the first query of the sky after a commit, under `sky_mutex`.
  std::mutex sky_mutex;
  std::unique_ptr<SkyMaps> sky_maps;
  std::unique_ptr<Sky> sky;

  AnswerCounts occlusion_counts, hit_counts;
};

// Unit, also where the length over- or underflows.
Vec3 unit(const Vec3& d, double& length);

// Gives unit directions to rays whose end is not finite, as rays of group.light without bounds must have, and to those
// whose direction's length is not usual.
void make_unit(RayBatch& rays, const UsualSquares& usual);

// Whether all coordinates are at most `most`: of no NaN.
bool is_within(const Vec3& position, double most);
// Throws Failure(FT_ERROR_INVALID_ARGUMENT) unless they are.
void require_within(const Vec3& position, double most, const std::string& name);

// Calls the device's progress callback, where nothing new is known some 20 times a second, and remembers that it asked
// to stop.
class Progress {
 public:
  explicit Progress(Device& device);
  void operator()(double share);
  const std::atomic<bool>* stop() const { return &stop_; }
  // Throws Failure(FT_ERROR_CANCELLED) if the callback asked to stop.
  void require_not_stopped() const;

 private:
  void ask();        // under the device's lock for callbacks, of the last share
  bool ask_again();  // false once it asked to stop

  Device& device_;
  FTProgressCallback callback_ = nullptr;
  void* user_ = nullptr;
  double share_ = 0.0;        // under the device's lock for callbacks
  std::exception_ptr error_;  // what it threw on the ticker's thread; before stop_ is set
  std::atomic<bool> stop_ = false;
  std::optional<Ticker> ticker_;
};

}  // namespace fieldtrace::api
