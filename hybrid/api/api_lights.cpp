// What points see of lights and of the sky, for the C interface.
#include <cmath>
#include <numeric>

#include "core/light/light_sampling.h"
#include "core/platform/parallel.h"
#include "core/surface/surface.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_visibility.hd.h"
#include "hybrid/api/api_buffers.h"
#include "hybrid/api/scene_object.h"
#include "hybrid/light/ambient_occlusion.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/sky/cell_occluders.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

constexpr size_t k_points_of_chunk = 256;
// Direction maps may take 1 / k_api_map_share of the fields' budget, in addition to it.
constexpr uint64_t k_api_map_share = 4;
// How far the length of a normal may be from 1.
constexpr float k_unit_slack = 1e-3f;

struct PointBuffers {
  Buffer<const float, 3> points, normals;
  Buffer<const uint32_t> from;
  size_t count() const { return points.count(); }
  uint32_t instance_of(size_t i) const { return from ? *from.at(i) : k_none; }
};

void require_points(const SceneObject& s, const PointBuffers& p) {
  p.points.needed(), p.normals.needed();
  for (size_t i = 0; i < p.count(); ++i) {
    const std::string number = std::to_string(i);
    require(is_finite(vector_at(p.points, i)), "point " + number + " is not finite");
    require(std::abs(glm::length(vector_at(p.normals, i)) - 1.0f) < k_unit_slack, "normal " + number + " is not unit");
    const uint32_t from = p.instance_of(i);
    require(from == k_none || from < s.scene.instances.size(),
            "point " + number + " lies on an instance that is not there");
  }
}

void set_point(const PointBuffers& from, size_t i, ShadingPointBatch& to, size_t j) {
  const Vec3 p = vector_at(from.points, i), n = vector_at(from.normals, i);
  to.px[j] = p.x, to.py[j] = p.y, to.pz[j] = p.z;
  to.gx[j] = to.sx[j] = n.x, to.gy[j] = to.sy[j] = n.y, to.gz[j] = to.sz[j] = n.z;
  // Of a point of a triangle by its barycentric coordinates, transformed.
  to.error[j] = gamma_bound(8) * (std::abs(p.x) + std::abs(p.y) + std::abs(p.z));
  to.radius[j] = 0.0f;
  to.seed[j] = to.sample[j] = 0;
  to.instance[j] = from.instance_of(i);
  to.transmits[j] = 0;
}

// A scene of nothing but the lights.
Scene scene_of_lights(const Buffer<const uint32_t>& shapes, const Buffer<const float, 9>& lights) {
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

struct LightResults {
  const Buffer<float>& shares;
  const Buffer<float>& certain;
  size_t light_count;
};

// One chunk of points and one light.
class LightChunk {
 public:
  LightChunk(const SceneObject& s, const LightTable& lights, uint32_t light, const LightExtent& extent)
      : s_(s), lights_(lights), light_(light), isa_(resolve_isa(Isa::automatic)) {
    group_.light = extent;
    group_.light.instance = k_none;  // a number of another scene
    group_.pixel_samples = k_strata;
  }

  void see(const ShadingPointBatch& points) {
    seen_.assign(points.size, {});
    group_.light_samples.assign(points.size, uint32_t(k_strata));
    s_.shadows->find_candidates(points, group_, stats_);
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
      } else if (!group_.by_rays[i] && s_.shadows->filters(group_)) {
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
    sample_light(lights_, light_, points, {k_strata, 0, k_strata, k_strata_side}, isa_, rays);
  }

  void filter(const ShadingPointBatch& points) {
    selected_.resize(filtered_.size());
    for (size_t r = 0; r < filtered_.size(); ++r) selected_.copy(r, points, filtered_[r], 1);
    sample(selected_, shares_);
    s_.shadows->filter(group_, points, filtered_, k_strata, shares_, undecided_, stats_);
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
    s_.shadows->answer(group_, traced_, stats_);
    for (size_t j = 0; j < left_.size(); ++j) {
      Seen& seen = seen_[left_[j] / uint32_t(k_strata)];
      seen.clear += traced_.blocked[j] ? 0.0f : 1.0f;
      seen.certain += !traced_.exact[j];
    }
  }

  const SceneObject& s_;
  const LightTable& lights_;
  uint32_t light_;
  Isa isa_;
  ShadowGroup group_;
  ShadowBatch rays_, shares_, traced_;
  ShadingPointBatch selected_;
  std::vector<uint32_t> filtered_, left_;
  std::vector<uint8_t> undecided_;
  std::vector<Seen> seen_;
  Stats stats_;
};

// Makes maps unless they are there.
const Sky& sky_of(SceneObject& s) {
  const std::lock_guard lock(s.sky_mutex);
  if (s.sky) return *s.sky;
  MappedShapes mapped = mapped_shapes(s.scene, s.traits);
  const MapSize size;
  if (DirectionMaps::bytes_of(size) * mapped.shapes.size() > s.fields->budget().limit() / k_api_map_share)
    throw Failure(FT_ERROR_OUT_OF_MEMORY, "ftSkyVisibility: the direction maps do not fit; raise \"field_memory\"");
  std::vector<std::unique_ptr<DirectionMaps>> maps;
  BakeCounters counters;
  tbb::this_task_arena::isolate([&] {
    for (const MappedShape& of : mapped.shapes) {
      maps.push_back(std::make_unique<DirectionMaps>(of.ball, size));
      const DMat3 to_object = of.is_deformed() ? glm::inverse(of.stretch) : DMat3(1.0);
      bake_maps(*maps.back(), *s.accel, of.shape, to_object, nullptr, counters);
    }
  });
  auto sky_maps =
      std::make_unique<SkyMaps>(s.scene, s.traits, std::move(mapped), std::move(maps), size.directions, SkyTolerance());
  auto sky = std::make_unique<Sky>(*sky_maps, SkyRadiance(white_sky()));
  s.sky_maps = std::move(sky_maps);
  s.sky = std::move(sky);
  return *s.sky;
}

// Points of one instance and one place.
class SkyBatch {
 public:
  SkyBatch(const SceneObject& s, const Sky& sky)
      : s_(s), sky_(sky), kernel_(cell_kernel_for(resolve_isa(Isa::automatic))) {}

  ShadingPointBatch points;

  void see(const Sphere& place) {
    const size_t n = points.size;
    for (size_t i = n; i < padded(n); ++i) points.copy(i, points, 0, 1);
    occluders_.find(sky_, points, place);
    const ShadingPointBatch& p = points;
    const CellPoints lanes = {p.px.data(), p.py.data(), p.pz.data(), p.gx.data(),        p.gy.data(), p.gz.data(),
                              p.sx.data(), p.sy.data(), p.sz.data(), int32_t(padded(n)), 0.0f};
    for (auto* v : {&hidden_, &green_, &blue_, &reflected_red_, &reflected_green_, &reflected_blue_})
      v->assign(padded(n), 0.0f);
    const CellSums sums = {hidden_.data(),        green_.data(),           blue_.data(),
                           reflected_red_.data(), reflected_green_.data(), reflected_blue_.data()};
    undecided_.resize(padded(n) + k_batch_padding);
    open_.assign(n, 0.0f);
    weights_.clear(), of_.clear(), directions_.clear();
    for (size_t k = 0; k < occluders_.cells().size(); ++k) {
      if (occluders_.is_clear(k)) continue;
      OwnObject own;
      const CellTask task = occluders_.task(k, own);
      const int open = kernel_(task, lanes, sums, undecided_.data());
      const Vec3 vector(task.vector[0], task.vector[1], task.vector[2]);
      for (int j = 0; j < open; ++j) {
        const auto point = uint32_t(undecided_[size_t(j)]);
        if (point >= n) break;  // padding
        const Vec3 normal(p.sx[point], p.sy[point], p.sz[point]);
        const float weight =
            scalar::cosine_over_cell<float>(glm::dot(vector, normal), task.cosine_half) * task.weight[0];
        if (!(weight > 0.0f)) continue;
        open_[point] += weight;
        of_.push_back(point), weights_.push_back(weight), directions_.push_back(occluders_.direction(k));
      }
    }
    trace();
  }

  float share(size_t i) const { return std::clamp(1.0f - hidden_[i] / whole(i), 0.0f, 1.0f); }
  float certain(size_t i) const { return std::clamp(1.0f - open_[i] / whole(i), 0.0f, 1.0f); }

 private:
  float whole(size_t i) const { return sky_.radiance().irradiance(Vec3(points.sx[i], points.sy[i], points.sz[i])).x; }

  // One exact ray through the middle of each undecided cell.
  void trace() {
    rays_.resize(of_.size());
    indices_.resize(of_.size());
    std::iota(indices_.begin(), indices_.end(), 0u);
    blocked_.assign(of_.size(), 0);
    for (size_t j = 0; j < of_.size(); ++j) {
      const uint32_t i = of_[j];
      const Vec3 p(points.px[i], points.py[i], points.pz[i]), g(points.gx[i], points.gy[i], points.gz[i]);
      rays_.set(j, offset_origin(p, g, points.error[i], directions_[j]), directions_[j], k_infinity);
    }
    s_.accel->occluded(rays_, indices_, blocked_.data());
    for (size_t j = 0; j < of_.size(); ++j) {
      const uint32_t i = of_[j];
      const Vec3 g(points.gx[i], points.gy[i], points.gz[i]);
      if (!blocked_[j] && glm::dot(g, directions_[j]) > 0.0f) hidden_[i] -= weights_[j];
    }
  }

  const SceneObject& s_;
  const Sky& sky_;
  CellKernel kernel_;
  CellOccluders occluders_;
  AlignedVector<float> hidden_, green_, blue_, reflected_red_, reflected_green_, reflected_blue_;
  AlignedVector<int32_t> undecided_;
  std::vector<float> open_, weights_;
  std::vector<uint32_t> of_, indices_;
  std::vector<Vec3> directions_;
  std::vector<uint8_t> blocked_;
  RayBatch rays_;
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
    const Scene lamps = scene_of_lights(kinds, places);
    if (point_count == 0 || light_count == 0) return;
    const LightTable table = make_lights(lamps);
    std::vector<LightExtent> extents;
    for (uint32_t k = 0; k < light_count; ++k) extents.push_back(light_extent(lamps, k));
    execute_in(s.device->arena, [&] {
      parallel_for((point_count + k_points_of_chunk - 1) / k_points_of_chunk, [&](size_t c) {
        tbb::this_task_arena::isolate([&] {
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
  });
}

FTError ftSkyVisibility(FTScene scene, const float* points, size_t point_stride, const float* normals,
                        size_t normal_stride, const uint32_t* from, size_t from_stride, size_t point_count,
                        float* shares, size_t share_stride, float* certain, size_t certain_stride) {
  return guarded(scene, [&](SceneObject& s) {
    const PointBuffers at = {{"points", points, point_stride, point_count},
                             {"normals", normals, normal_stride, point_count},
                             {"from", from, from_stride, point_count}};
    const Buffer<float> seen("shares", shares, share_stride, point_count);
    const Buffer<float> sure("certain", certain, certain_stride, point_count);
    at.from.needed(), seen.needed();
    require_apart(seen, at.points, at.normals, at.from, sure);
    require_apart(sure, at.points, at.normals, at.from);
    const std::shared_lock lock(s.mutex);
    s.require_commit("ftSkyVisibility");
    require_points(s, at);
    for (size_t i = 0; i < point_count; ++i)
      require(at.instance_of(i) != k_none, "point " + std::to_string(i) + " lies on no instance");
    if (point_count == 0) return;
    execute_in(s.device->arena, [&] {
      const Sky& sky = sky_of(s);
      std::vector<size_t> order(point_count);
      std::iota(order.begin(), order.end(), size_t(0));
      std::stable_sort(order.begin(), order.end(),
                       [&](size_t a, size_t b) { return at.instance_of(a) < at.instance_of(b); });
      parallel_for((point_count + k_points_of_chunk - 1) / k_points_of_chunk, [&](size_t c) {
        tbb::this_task_arena::isolate([&] {
          const size_t last = std::min(point_count, (c + 1) * k_points_of_chunk);
          SkyBatch batch(s, sky);
          for (size_t begin = c * k_points_of_chunk, end = begin; begin < last; begin = end) {
            const uint32_t instance = at.instance_of(order[begin]);
            const auto place_of = [&](size_t k) { return sky.maps().place(instance, vector_at(at.points, order[k])); };
            const Sphere place = place_of(begin);
            for (end = begin + 1; end < last && at.instance_of(order[end]) == instance; ++end) {
              if (place_of(end).centre != place.centre) break;
            }
            batch.points.resize(end - begin);
            for (size_t k = begin; k < end; ++k) set_point(at, order[k], batch.points, k - begin);
            batch.see(place);
            for (size_t k = begin; k < end; ++k) {
              *seen.at(order[k]) = batch.share(k - begin);
              if (sure) *sure.at(order[k]) = batch.certain(k - begin);
            }
          }
        });
      });
    });
  });
}
