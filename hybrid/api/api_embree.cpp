// Instances of the C interface within Embree scenes of other programs.
#include <tbb/task_arena.h>

#include <algorithm>
#include <map>

#include "core/surface/surface.h"
#include "core/trace/user_geometry.h"
#include "fieldtrace/fieldtrace_embree.h"
#include "hybrid/api/scene_object.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

struct Scratch {
  ShadowBatch batch;
  ShadowGroup group;
  RayBatch open;
  HitBatch hits;
  std::vector<uint32_t> lanes;
  Stats stats;  // nobody reads it
};
// Of this thread.
Scratch& scratch() {
  thread_local Scratch s;
  return s;
}

class InstanceGeometry final : public UserGeometry {
 public:
  // `scene` must outlive this.
  InstanceGeometry(const SceneObject& scene, uint32_t instance) : scene_(scene), instance_(instance) {}

  Bounds3 bounds() const noexcept override {
    const std::shared_lock lock(scene_.mutex);
    const Instance& placed = scene_.scene.instances[instance_];
    Bounds3 b;
    b.extend(placed.to_world, scene_.scene.shapes[placed.shape].bounds);
    const Vec3 slack = gamma_bound(8) * (glm::max(glm::abs(b.lower), glm::abs(b.upper)) + b.diagonal());
    return {b.lower - slack, b.upper + slack};
  }

  void occluded(const RayBatch& rays, uint8_t* blocked) const noexcept override {
    query([&](Scratch& s) {
      fill(rays, s);
      scene_.shadows->answer({s.group, s.batch, s.stats});
      std::copy_n(s.batch.blocked.data(), rays.size, blocked);
    });
  }

  void intersect(const RayBatch& rays, Hit* hits) const noexcept override {
    query([&](Scratch& s) {
      // Where the field is certain that nothing is met, no ray is traced.
      fill(rays, s);
      scene_.shadows->look_up(s.group, s.batch, s.stats);
      s.lanes.clear();
      s.open.resize(rays.size);
      for (uint32_t i = 0; i < rays.size; ++i) {
        if (!(rays.tmax[i] >= 0.0f) || !(s.batch.exact[i] || s.batch.blocked[i])) continue;
        // The caller's, so that its hit does not depend on where the traversal has shortened it.
        s.open.copy(s.lanes.size(), is_usual(rays.direction(i)) ? rays : s.batch.rays, i);
        s.lanes.push_back(i);
      }
      if (s.lanes.empty()) return;
      s.open.resize(s.lanes.size());
      s.hits.resize(s.lanes.size());
      scene_.accel->intersect_with(instance_, s.open, s.hits);
      for (size_t k = 0; k < s.lanes.size(); ++k) {
        if (s.hits.instance[k] == k_none) continue;
        const Vec3 normal = surface_at(scene_.scene, s.open, s.hits, k).geometric_normal;
        const Vec3 given = rays.direction(s.lanes[k]);
        double length = 1.0;
        if (!is_usual(given)) unit(given, length);  // it has been traced as a unit direction
        const auto t = float(double(s.hits.t[k]) / length);
        hits[s.lanes[k]] = {true, t, s.hits.u[k], s.hits.v[k], normal, s.hits.primitive[k]};
      }
    });
  }

 private:
  // Embree's callers take no errors: the rays meet nothing then, and the device's callback hears of it.
  template <class Body>
  void query(const Body& body) const noexcept {
    (void)guarded(scene_.device, [&] {
      const std::shared_lock lock(scene_.mutex);
      scene_.require_commit("a ray to an attached instance");
      // A thread that waits in a bake must not begin another query with the same scratch memory.
      tbb::this_task_arena::isolate([&] { body(scratch()); });
    });
  }

  bool is_usual(const Vec3& direction) const { return scene_.usual.has(glm::dot(direction, direction)); }

  void fill(const RayBatch& rays, Scratch& s) const {
    s.batch.resize(rays.size);
    for (size_t i = 0; i < rays.size; ++i) {
      s.batch.rays.set(i, rays.origin(i), rays.direction(i), rays.tmax[i]);
      if (rays.tmax[i] >= 0.0f && !is_within(rays.origin(i), scene_.largest_coordinate))
        throw Failure(FT_ERROR_INVALID_ARGUMENT, "a ray to an attached instance starts too far from the scene");
      s.batch.instance[i] = k_none;
    }
    make_unit(s.batch.rays, scene_.usual);
    s.group.candidates.assign(1, instance_);
    s.group.is_tested = false;
    s.group.open.clear();
  }

  const SceneObject& scene_;
  const uint32_t instance_;
};

// Attaches all instances or none. Throws Failure if Embree refuses.
std::vector<std::unique_ptr<AttachedGeometry>> attach(const SceneObject& s, RTCDevice embree, RTCScene target) {
  size_t count = 0;
  {
    const std::shared_lock lock(s.mutex);
    s.require_commit("ftAttachEmbree");
    count = s.scene.instances.size();
  }
  // Not under the lock: Embree asks for bounds.
  std::vector<std::unique_ptr<AttachedGeometry>> made;
  for (uint32_t i = 0; i < count; ++i) {
    try {
      made.push_back(std::make_unique<AttachedGeometry>(embree, target, std::make_unique<InstanceGeometry>(s, i)));
    } catch (const Error& e) {
      throw Failure(FT_ERROR_INVALID_ARGUMENT, std::string("ftAttachEmbree: ") + e.what());
    }
  }
  return made;
}

// What is attached, by the handle and the caller's scene. It keeps the object, so that it outlives the handle, which is
// never used for another one.
struct Attachment {
  std::shared_ptr<SceneObject> scene;
  std::vector<std::unique_ptr<AttachedGeometry>> geometries;  // destroyed before it
};

struct Attachments {
  std::mutex mutex;
  std::map<std::pair<FTScene, RTCScene>, Attachment> all;
};

// Never destroyed, as the registry of handles.
Attachments& attachments() {
  static Attachments* const a = new Attachments;
  return *a;
}

}  // namespace

FTError ftAttachEmbree(FTScene scene, RTCDevice embree, RTCScene target, uint32_t* geometry_ids) {
  return guarded(device_of(scene), [&] {
    Attachment made{find(scene), {}};
    require(embree != nullptr, "ftAttachEmbree: the Embree device is null");
    require(target != nullptr, "ftAttachEmbree: the Embree scene is null");
    if (geometry_ids) require_place(geometry_ids, "ftAttachEmbree: the geometry IDs");
    Attachments& a = attachments();
    const std::lock_guard lock(a.mutex);
    require(!a.all.contains({scene, target}), "ftAttachEmbree: this scene is attached to that Embree scene already");
    made.geometries = attach(*made.scene, embree, target);
    const auto& geometries = a.all.emplace(std::pair(scene, target), std::move(made)).first->second.geometries;
    if (!geometry_ids) return;
    std::transform(geometries.begin(), geometries.end(), geometry_ids, [](const auto& g) { return g->id(); });
  });
}

FTError ftDetachEmbree(FTScene scene, RTCScene target) {
  return guarded(device_of(scene), [&] {
    Attachment ended;  // destroyed without the lock
    Attachments& a = attachments();
    const std::lock_guard lock(a.mutex);
    const auto found = a.all.find({scene, target});
    if (found == a.all.end()) {
      (void)find(scene);
      require(false, "ftDetachEmbree: nothing of this scene is attached to that Embree scene");
    }
    ended = std::move(found->second);
    a.all.erase(found);
  });
}
