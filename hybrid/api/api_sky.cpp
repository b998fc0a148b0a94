// What points see of the sky, for the C interface: by direction cells, as hybrid/light/sky_light.h, and with one exact
// ray through each that maps leave undecided.
#include <numeric>

#include "core/platform/parallel.h"
#include "core/surface/surface.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_visibility.hd.h"
#include "hybrid/api/api_points.h"
#include "hybrid/light/ambient_occlusion.h"
#include "hybrid/sky/cell_occluders.h"
#include "hybrid/sky/enclosed_points.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

// Makes maps unless they are there.
const Sky& sky_of(SceneObject& s) {
  const std::lock_guard lock(s.sky_mutex);
  if (s.sky) return *s.sky;
  MappedShapes mapped = mapped_shapes(s.scene, s.traits);
  const MapSize size;
  if (DirectionMaps::bytes_of(size) * mapped.shapes.size() > s.fields->budget().limit() / FieldBudget::k_map_share)
    throw Failure(FT_ERROR_OUT_OF_MEMORY, "ftSkyVisibility: the direction maps do not fit; raise \"field_memory\"");
  std::vector<std::shared_ptr<DirectionMaps>> maps;
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
  SkyBatch(const SceneObject& s, const Sky& sky) : s_(s), sky_(sky), isa_(resolve_isa(Isa::automatic)) {}

  ShadingPointBatch points;

  void see(const Sphere& place) {
    const size_t n = points.size;
    for (size_t i = n; i < padded(n); ++i) points.copy(i, points, 0);
    occluders_.find(sky_, points, place);
    see_cells();
    whole_.resize(n), seen_.resize(n);
    for (size_t i = 0; i < n; ++i) whole_[i] = sky_.radiance().irradiance(normal(i)).x;
    enclosed_.scale(sky_, points, whole_, isa_, {hidden_.data(), green_.data(), blue_.data()});
    for (size_t i = 0; i < n; ++i) seen_[i] = whole_[i] - hidden_[i];
    trace();
  }

  float share(size_t i) const { return std::clamp(seen_[i] / whole_[i], 0.0f, 1.0f); }
  float certain(size_t i) const { return std::clamp(1.0f - open_[i] / whole_[i], 0.0f, 1.0f); }

 private:
  // An undecided cell, and its part of the point's irradiance.
  struct OpenCell {
    uint32_t point;
    float weight;
    Vec3 direction;
  };

  Vec3 normal(size_t i) const { return points.shading_normal(i); }

  void see_cells() {
    for (auto* v : {&hidden_, &green_, &blue_, &reflected_red_, &reflected_green_, &reflected_blue_})
      v->assign(padded(points.size), 0.0f);
    const CellSums sums = {hidden_.data(),        green_.data(),           blue_.data(),
                           reflected_red_.data(), reflected_green_.data(), reflected_blue_.data()};
    open_cells_.clear();
    open_.assign(points.size, 0.0f);
    occluders_.see(isa_, cell_points(points), sums, scratch_, [&](const CellTask& task, size_t k, uint32_t i) {
      const Vec3 vector(task.vector[0], task.vector[1], task.vector[2]);
      const float cosine = scalar::cosine_over_cell<float>(glm::dot(vector, normal(i)), task.cosine_half);
      if (!(cosine > 0.0f)) return;
      open_cells_.push_back({i, cosine * task.weight[0], occluders_.direction(k)});
      open_[i] += open_cells_.back().weight;
    });
  }

  // One exact ray through the middle of each undecided cell.
  void trace() {
    const size_t n = open_cells_.size();
    rays_.resize(n);
    indices_.resize(n);
    std::iota(indices_.begin(), indices_.end(), 0u);
    blocked_.assign(n, 0);
    for (size_t j = 0; j < n; ++j) {
      const auto& [i, weight, direction] = open_cells_[j];
      const Vec3 p = points.position(i);
      rays_.set(j, offset_origin(p, normal(i), points.error[i], direction), direction, k_infinity);
    }
    s_.accel->occluded(rays_, indices_, blocked_.data());
    for (size_t j = 0; j < n; ++j) {
      const auto& [i, weight, direction] = open_cells_[j];
      if (!blocked_[j] && glm::dot(normal(i), direction) > 0.0f) seen_[i] += weight;
    }
  }

  const SceneObject& s_;
  const Sky& sky_;
  Isa isa_;
  CellOccluders occluders_;
  EnclosedPoints enclosed_;
  AlignedVector<float> hidden_, green_, blue_, reflected_red_, reflected_green_, reflected_blue_;
  CellScratch scratch_;
  std::vector<OpenCell> open_cells_;
  std::vector<float> whole_, seen_, open_;  // irradiance, by point: of the open sky; what is seen; of undecided cells
  std::vector<uint32_t> indices_;
  std::vector<uint8_t> blocked_;
  RayBatch rays_;
};

}  // namespace

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
      parallel_for_isolated((point_count + k_points_of_chunk - 1) / k_points_of_chunk, [&](size_t c) {
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
}
