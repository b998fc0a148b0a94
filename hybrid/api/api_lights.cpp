// What points see of lights, for the C interface.
#include <cmath>

#include "core/light/light_sampling.h"
#include "core/platform/parallel.h"
#include "hybrid/api/api_points.h"
#include "hybrid/light/direct_light.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

// A scene of nothing but the lights, of coordinates of at most `most`.
Scene scene_of_lights(const Buffer<const uint32_t>& shapes, const Buffer<const float, 9>& lights, double most) {
  Scene scene;
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk, ShapeKind::rectangle}) {
    Shape shape;
    shape.kind = kind;
    const float height = kind == ShapeKind::sphere ? 1.0f : 0.0f;
    shape.bounds.extend(Vec3(-1.0f, -1.0f, -height));
    shape.bounds.extend(Vec3(1.0f, 1.0f, height));
    if (kind == ShapeKind::rectangle) {
      shape.mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
      shape.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    }
    scene.shapes.push_back(std::move(shape));
  }
  for (size_t k = 0; k < lights.count(); ++k) {
    const std::string number = std::to_string(k);
    const uint32_t shape = *shapes.at(k);
    require(shape <= FT_LIGHT_RECTANGLE, "light " + number + " has no known shape");
    const float* const v = lights.at(k);
    const Vec3 centre(v[0], v[1], v[2]), x(v[3], v[4], v[5]), y(v[6], v[7], v[8]);
    const bool is_sphere = shape == FT_LIGHT_SPHERE;
    const float size = is_sphere ? glm::length(x) : glm::length(glm::cross(x, y));
    require(is_finite(centre) && is_finite(x) && (is_sphere || is_finite(y)) && size > 0.0f && std::isfinite(size),
            "light " + number + " is not finite, or has no area");
    for (const Vec3& part : {centre, x, is_sphere ? x : y}) require_within(part, most, "light " + number);
    Instance instance;
    instance.shape = shape;
    instance.emitter = uint32_t(k);
    instance.to_world = is_sphere ? Affine(Vec3(size, 0, 0), Vec3(0, size, 0), Vec3(0, 0, size), centre)
                                  : Affine(x, y, glm::normalize(glm::cross(x, y)), centre);
    instance.to_object = Affine(inverse_affine(DAffine(instance.to_world)));
    scene.instances.push_back(instance);
    Emitter emitter;
    emitter.instance = uint32_t(k);
    scene.emitters.push_back(emitter);
  }
  return scene;
}

// One chunk of points and one light.
class LightChunk {
 public:
  LightChunk(const SceneObject& s, const LightTable& lights, uint32_t light, const LightExtent& extent)
      : s_(s), lights_(lights), light_(light), isa_(resolve_isa(Isa::automatic)) {
    group_.light = extent;
    group_.light.instance = k_none;  // a number of another scene
    group_.pixel_samples = k_strata;
    const StrataGrid grid = strata_grid(lights.lights[light]);
    has_strata_ = grid.columns > 0;
    if (has_strata_) columns_ = grid.columns;
  }

  void see(const ShadingPointBatch& points) {
    seen_.assign(points.size, {});
    group_.light_samples.assign(points.size, uint32_t(k_strata));
    s_.shadows->find_candidates({points, group_, stats_});
    sample(points, rays_);
    filtered_.clear(), left_.clear();
    for (uint32_t i = 0; i < points.size; ++i) {
      Seen& seen = seen_[i];
      for (size_t slot = size_t(i) * k_strata; slot < size_t(i + 1) * k_strata; ++slot)
        seen.active += rays_.rays.tmax[slot] >= 0.0f;
      const int32_t shadow = group_.shadow[i];
      if (!shadow || shadow & k_light_blocked) {
        seen.certain = seen.active;
        seen.clear = shadow ? 0.0f : float(seen.active);
      } else if (has_strata_ && !group_.by_rays[i] && s_.shadows->filters(group_)) {
        filtered_.push_back(i);
      } else {
        for (uint32_t k = 0; k < uint32_t(k_strata); ++k) left_.push_back(i * uint32_t(k_strata) + k);
      }
    }
    if (!filtered_.empty()) filter(points);
    trace();
  }

  float share(size_t i) const { return seen_[i].active ? seen_[i].clear / float(seen_[i].active) : 0.0f; }
  float certain(size_t i) const { return seen_[i].active ? float(seen_[i].certain) / float(seen_[i].active) : 1.0f; }

 private:
  struct Seen {
    int active = 0, certain = 0;  // strata
    float clear = 0.0f;
  };

  void sample(const ShadingPointBatch& points, ShadowBatch& rays) const {
    sample_light(lights_, light_, points, {k_strata, 0, k_strata, columns_}, isa_, rays);
  }

  void filter(const ShadingPointBatch& points) {
    selected_.resize(filtered_.size());
    for (size_t r = 0; r < filtered_.size(); ++r) selected_.copy(r, points, filtered_[r]);
    sample(selected_, shares_);
    s_.shadows->filter({group_, points, filtered_, k_strata, shares_, undecided_, stats_});
    for (size_t r = 0; r < filtered_.size(); ++r) {
      Seen& seen = seen_[filtered_[r]];
      for (size_t k = 0; k < size_t(k_strata); ++k) {
        const size_t slot = r * k_strata + k;
        if (shares_.rays.tmax[slot] < 0.0f) continue;
        if (undecided_[slot]) {
          left_.push_back(uint32_t(filtered_[r] * size_t(k_strata) + k));
          continue;
        }
        ++seen.certain;
        seen.clear += shares_.clear[slot];
      }
    }
  }

  // The rays through the centres of the strata that are left.
  void trace() {
    std::erase_if(left_, [&](uint32_t slot) { return rays_.rays.tmax[slot] < 0.0f; });
    traced_.resize(left_.size());
    for (size_t j = 0; j < left_.size(); ++j) {
      traced_.rays.copy(j, rays_.rays, left_[j]);
      traced_.instance[j] = rays_.instance[left_[j]];
    }
    if (left_.empty()) return;
    s_.shadows->answer({group_, traced_, stats_});
    for (size_t j = 0; j < left_.size(); ++j) {
      Seen& seen = seen_[left_[j] / uint32_t(k_strata)];
      seen.clear += traced_.blocked[j] ? 0.0f : 1.0f;
      seen.certain += !traced_.exact[j];
    }
  }

  const SceneObject& s_;
  const LightTable& lights_;
  uint32_t light_;
  bool has_strata_ = false;
  int columns_ = 4;  // of the sample points
  Isa isa_;
  ShadowGroup group_;
  ShadowBatch rays_, shares_, traced_;
  ShadingPointBatch selected_;
  std::vector<uint32_t> filtered_, left_;
  std::vector<uint8_t> undecided_;
  std::vector<Seen> seen_;
  Stats stats_;
};

}  // namespace

FTError ftLightVisibility(FTScene scene, const float* points, size_t point_stride, const float* normals,
                          size_t normal_stride, const uint32_t* from, size_t from_stride, size_t point_count,
                          const uint32_t* shapes, size_t shape_stride, const float* lights, size_t light_stride,
                          size_t light_count, float* shares, size_t share_stride, float* certain,
                          size_t certain_stride) {
  return guarded(scene, [&](SceneObject& s) {
    const PointBuffers at = {{"points", points, point_stride, point_count},
                             {"normals", normals, normal_stride, point_count},
                             {"from", from, from_stride, point_count}};
    const Buffer<const uint32_t> kinds("shapes", shapes, shape_stride, light_count);
    const Buffer<const float, 9> places("lights", lights, light_stride, light_count);
    kinds.needed(), places.needed();
    require(light_count == 0 || point_count <= std::numeric_limits<uint32_t>::max() / light_count,
            "ftLightVisibility: too many points times lights");
    const Buffer<float> seen("shares", shares, share_stride, point_count * light_count);
    const Buffer<float> sure("certain", certain, certain_stride, point_count * light_count);
    seen.needed();
    require_apart(seen, at.points, at.normals, at.from, kinds, places, sure);
    require_apart(sure, at.points, at.normals, at.from, kinds, places);
    const std::shared_lock lock(s.mutex);
    s.require_commit("ftLightVisibility");
    require_points(s, at);
    const Scene lamps = scene_of_lights(kinds, places, s.largest_coordinate);
    if (point_count == 0 || light_count == 0) return;
    const LightTable table = make_lights(lamps);
    std::vector<LightExtent> extents;
    for (uint32_t k = 0; k < light_count; ++k) extents.push_back(light_extent(lamps, k));
    execute_in(s.device->arena, [&] {
      parallel_for_isolated((point_count + k_points_of_chunk - 1) / k_points_of_chunk, [&](size_t c) {
        const size_t begin = c * k_points_of_chunk, end = std::min(point_count, begin + k_points_of_chunk);
        ShadingPointBatch batch;
        batch.resize(end - begin);
        for (size_t j = 0; j < padded(end - begin); ++j) set_point(at, std::min(begin + j, end - 1), batch, j);
        for (uint32_t k = 0; k < light_count; ++k) {
          LightChunk chunk(s, table, k, extents[k]);
          chunk.see(batch);
          for (size_t i = begin; i < end; ++i) {
            *seen.at(i * light_count + k) = chunk.share(i - begin);
            if (sure) *sure.at(i * light_count + k) = chunk.certain(i - begin);
          }
        }
      });
    });
  });
}
