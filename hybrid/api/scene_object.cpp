#include "hybrid/api/scene_object.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <system_error>

#include "core/loader/scene_limits.h"
#include "core/math/finite.h"
#include "core/platform/address_space.h"

namespace fieldtrace::api {

void check_limits(const Scene& scene) {
  ScenePlaces places;
  for (size_t i = 0; i < scene.instances.size(); ++i) places.instances.push_back({"instance " + std::to_string(i)});
  places.camera = {"the camera"};
  check_scene_limits(scene, places);
}

void SceneObject::commit() {
  const bool is_first = !fields;
  try {
    prepare();
  } catch (...) {
    hits.reset(), shadows.reset(), accel.reset();
    if (is_first) demands.clear(), fields.reset();  // so that other sizes of fields may be set
    throw;
  }
}

void SceneObject::prepare() {
  was_committed = false;
  sky.reset(), sky_maps.reset();
  hits.reset(), shadows.reset(), accel.reset();
  for (size_t i = 0; i < transforms.size(); ++i) {
    Instance& instance = scene.instances[i];
    instance.to_world = transforms[i];
    instance.to_object = Affine(inverse_affine(DAffine(transforms[i])));
  }
  fit_clips();
  check_limits(scene);
  const RayLimits limits = ray_limits(scene);
  if (!(limits.largest_coordinate > 0.0))
    throw Error(
        "an instance is scaled so far down, for its distance from the origin, that single precision cannot hold "
        "rays to it; use larger units, or bring it nearer");
  largest_coordinate = float(limits.largest_coordinate);
  usual = {float(limits.shortest_direction * limits.shortest_direction),
           float(std::min(limits.longest_direction * limits.longest_direction, 0x1p126))};
  if (!fields) make_fields();
  accel = std::make_unique<Accel>(scene);
  tolerance = options.tolerance;
  AnswererSettings settings;
  settings.isa = resolve_isa(Isa::automatic);
  settings.tolerance = base_tolerance();
  settings.demands = demands;
  std::vector<Field*> shadow_fields = fields->pointers();
  if (settings.tolerance == 0.0f) std::fill(shadow_fields.begin(), shadow_fields.end(), nullptr);  // all rays are exact
  shadows = std::make_unique<ShadowAnswerer>(scene, *accel, traits, shadow_fields, settings);
  hit_fields = fields->all_pointers();
  std::vector<uint32_t> suited = HitAnswerer::suited_instances(scene, traits, parameters, 0);
  std::erase_if(suited, [&](uint32_t i) { return !hit_fields[scene.instances[i].shape]; });
  // At tolerance 1 cells answer whose error has no known bound.
  if (settings.tolerance >= 1.0f) suited.clear();
  has_certified_hits.assign(scene.instances.size(), 0);
  for (const uint32_t i : suited) has_certified_hits[i] = 1;
  if (!suited.empty()) hits = std::make_unique<HitAnswerer>(scene, *accel, traits, hit_fields, suited, settings);
  was_committed = true;
}

void SceneObject::make_fields() {
  traits = shape_traits(scene);
  FieldPlan plan;
  plan.parameters = parameters;
  const uint64_t memory = options.field_memory ? options.field_memory : default_field_memory();
  fields.emplace(scene, traits, plan, memory, true, reservable_bytes());
  demands.clear();
  for (const Field* field : fields->all_pointers())
    demands.push_back(field ? std::make_unique<SliceDemand>(*field) : nullptr);
}

void SceneObject::fit_clips() {
  if (!fits_clips) return;
  // A thousand times nearer than anything that pictures of the whole scene show sharply.
  constexpr float k_near_share = 1e-6f;
  const Vec3 eye = scene.camera.to_world[3];
  const Bounds3 box = scene.world_bounds();
  float farthest = 0.0f;
  for (int c = 0; c < 8; ++c) farthest = std::max(farthest, glm::length(box.corner(c) - eye));
  if (!(farthest > 0.0f && farthest < k_infinity)) return;
  scene.camera.far_clip = 2.0f * farthest;
  scene.camera.near_clip = k_near_share * farthest;
}

void SceneObject::require_commit(const char* function) const {
  if (!was_committed)
    throw Failure(FT_ERROR_INVALID_OPERATION, std::string(function) + ": the scene is not committed (ftCommitScene)");
}

Field* SceneObject::field_of(uint32_t mesh) const {
  require(mesh < scene.shapes.size(), "there is no mesh " + std::to_string(mesh));
  return mesh < hit_fields.size() ? hit_fields[mesh] : nullptr;
}

Vec3 unit(const Vec3& d, double& length) {
  length = glm::length(DVec3(d));
  return Vec3(DVec3(d) / length);
}

bool is_within(const Vec3& position, double most) {
  const DVec3 far = glm::abs(DVec3(position));
  return far.x <= most && far.y <= most && far.z <= most;
}

void require_within(const Vec3& position, double most, const std::string& name) {
  if (is_within(position, most)) return;
  throw Failure(FT_ERROR_INVALID_ARGUMENT,
                fmt::format("{} lies beyond the coordinate {:.2g}, too far off", name, most));
}

void make_unit(RayBatch& rays, const UsualSquares& usual) {
  for (size_t i = 0; i < rays.size; ++i) {
    const float t = rays.tmax[i];
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    if (!(t >= 0.0f) || (is_finite(o + t * d) && usual.has(glm::dot(d, d)))) continue;
    double length = 0.0;
    const Vec3 direction = unit(d, length);
    rays.set(i, o, direction, t == k_infinity ? t : float(double(t) * length));
  }
}

Progress::Progress(Device& device) : device_(device) {
  const std::lock_guard lock(device.mutex);
  callback_ = device.on_progress, user_ = device.progress_user;
  if (!callback_) return;
  try {
    ticker_.emplace(std::chrono::milliseconds(50), [this] { return ask_again(); });
  } catch (const std::system_error&) {
    // Without a thread to spare it is asked where work reports.
  }
}

void Progress::operator()(double share) {
  if (!callback_) return;
  const std::lock_guard lock(device_.progress_mutex);
  share_ = share;
  ask();
}

void Progress::ask() {
  if (!stop_ && !callback_(user_, share_)) stop_ = true;
}

// A tile of many samples reports nothing for seconds.
bool Progress::ask_again() {
  try {
    const std::lock_guard lock(device_.progress_mutex);
    ask();
  } catch (...) {
    error_ = std::current_exception();
    stop_ = true;
  }
  return !stop_;
}

void Progress::require_not_stopped() const {
  if (stop_ && error_) std::rethrow_exception(error_);
  if (stop_) throw Failure(FT_ERROR_CANCELLED, "cancelled by the progress callback");
}

}  // namespace fieldtrace::api
