#include "hybrid/lobe_answerer.h"

#include <algorithm>
#include <numeric>

#include "field/chart.hd.h"
#include "hybrid/shape_traits.h"

namespace fieldtrace {
namespace {

// At the default tolerance half a texel may take an eighth of alpha: the slopes of a lobe's microfacets are spread by
// about alpha, reflected directions by twice that.
constexpr float k_blur_of_tolerance = 1.25f;
// How many rounds of baking a batch can need: the tube, the first disc and the second.
constexpr int k_most_rounds = 4;
// Shares of a ray smaller than this are not followed.
constexpr float k_least_share = 0x1p-12f;

void copy_ray(const RayBatch& from, size_t i, RayBatch& to, size_t j) {
  to.set(j, from.origin(i), from.direction(i), from.tmax[i]);
}

void copy_hit(const HitBatch& from, size_t i, HitBatch& to, size_t j) {
  to.t[j] = from.t[i], to.u[j] = from.u[i], to.v[j] = from.v[i];
  to.instance[j] = from.instance[i], to.primitive[j] = from.primitive[i];
}

// Rays of one direction cell one after another: their look-ups then read the same pictures.
void order_by_direction(const RayBatch& rays, std::vector<uint32_t>& indices) {
  constexpr int k_cells = RadiancePictures::k_directions;
  constexpr ChartAxis k_axis = make_axis(k_cells);
  std::vector<uint32_t> begin(size_t(k_cells) * k_cells + 1, 0), sorted(indices.size());
  std::vector<uint16_t> keys(indices.size());
  for (size_t j = 0; j < indices.size(); ++j) {
    const Vec3 d = rays.direction(indices[j]);
    scalar::CellAddress<float> cell;
    scalar::find_direction_cell<float>({d.x, d.y, d.z}, k_axis, cell);
    keys[j] = uint16_t(cell.u * k_cells + cell.v);
    ++begin[keys[j] + 1u];
  }
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  for (size_t j = 0; j < indices.size(); ++j) sorted[begin[keys[j]]++] = indices[j];
  indices.swap(sorted);
}

// One object's share in a ray.
struct Layer {
  float distance;
  const LobeAnswers* answers;
};

// Objects front to back, those before the hit at `end`; returns the share that none of them stops.
float compose(std::vector<Layer>& layers, size_t i, float end, Rgb& arriving) {
  std::sort(layers.begin(), layers.end(), [](const Layer& a, const Layer& b) { return a.distance < b.distance; });
  float clear = 1.0f;
  for (const Layer& layer : layers) {
    if (layer.distance >= end) break;
    const LobeAnswers& a = *layer.answers;
    arriving += Rgb(a.red[i], a.green[i], a.blue[i]) * clear;
    clear *= a.clear[i];
  }
  return clear;
}

}  // namespace

LobeAnswerer::LobeAnswerer(const TransportContext& shading, float tolerance, uint64_t most_rays, uint64_t most_bytes)
    : shading_(shading), kernels_(segment_kernels(shading.settings.isa)), blur_(k_blur_of_tolerance * tolerance) {
  const Scene& scene = shading.scene;
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  std::vector<uint32_t> suited, others;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const bool suits = traits[scene.instances[i].shape].wants_field && SurfaceRadiance::suits(scene, i);
    (suits ? suited : others).push_back(i);
  }
  if (suited.size() > k_most_objects) return;
  for (const uint32_t i : suited) {
    auto pictures = std::make_unique<RadiancePictures>(scene, i, most_rays);
    const uint64_t samples =
        uint64_t(pictures->radiance().patch_count()) * SurfaceRadiance::k_light_samples * scene.emitters.size();
    const uint64_t bytes = pictures->radiance().bytes() + pictures->tiles().bytes_when_full();
    if (samples > most_rays || bytes > most_bytes) {
      others.push_back(i);
      continue;
    }
    most_bytes -= bytes;
    pictures_.push_back(std::move(pictures));
  }
  has_others_ = !others.empty();
  if (!pictures_.empty() && has_others_) others_ = shading_.accel.group(others);
}

LobeAnswerer::~LobeAnswerer() = default;

uint64_t LobeAnswerer::bytes() const {
  uint64_t sum = 0;
  for (const auto& p : pictures_) sum += p->radiance().bytes() + p->tiles().bytes();
  return sum;
}

void LobeAnswerer::ask(RadiancePictures& pictures, const LobeBatch& lobes, LobeAnswers& answers, ConeUnknowns& unknowns,
                       Stats& stats) const {
  const size_t n = lobes.rays.size;
  answers.resize(n);
  unknowns.blocks.clear();
  for (size_t i = 0; i < n; i += k_batch_padding) unknowns.blocks.push_back(uint32_t(i));
  std::vector<uint32_t> blocks;
  for (int round = 0; round < k_most_rounds && !unknowns.blocks.empty(); ++round) {
    blocks.swap(unknowns.blocks);
    unknowns.blocks.clear();
    unknowns.tiles.clear();
    stats.lookups += kernels_.filter_lobes(pictures.task(), lobes, blocks, answers, unknowns);
    if (unknowns.tiles.empty()) break;
    std::sort(unknowns.tiles.begin(), unknowns.tiles.end());
    unknowns.tiles.erase(std::unique(unknowns.tiles.begin(), unknowns.tiles.end()), unknowns.tiles.end());
    pictures.bake(unknowns.tiles, shading_, stats);
  }
  for (const uint32_t block : unknowns.blocks) std::fill_n(answers.refused.begin() + block, k_batch_padding, 1);
}

void LobeAnswerer::answer(const RayBatch& rays, std::span<const LobeRay> lobes, LobeResults& results,
                          Stats& stats) const {
  const size_t n = rays.size;
  results.hits.resize(n);
  results.arriving.assign(n, Rgb(0.0f));
  results.clear.assign(n, 1.0f);

  std::vector<uint32_t> asked, exact;
  for (uint32_t i = 0; i < n; ++i) (lobes[i].density > 0.0f ? asked : exact).push_back(i);
  order_by_direction(rays, asked);
  LobeBatch batch;
  batch.resize(asked.size());
  for (size_t j = 0; j < asked.size(); ++j) {
    const LobeRay& lobe = lobes[asked[j]];
    copy_ray(rays, asked[j], batch.rays, j);
    batch.nx[j] = lobe.normal.x, batch.ny[j] = lobe.normal.y, batch.nz[j] = lobe.normal.z;
    batch.density[j] = lobe.density;
    batch.blur[j] = blur_ * lobe.alpha;
    batch.instance[j] = lobe.instance;
  }
  std::vector<LobeAnswers> answers(pictures_.size());
  ConeUnknowns unknowns;
  for (size_t p = 0; p < pictures_.size() && !asked.empty(); ++p) {
    ask(*pictures_[p], batch, answers[p], unknowns, stats);
  }

  HitBatch rest;
  rest.resize(asked.size());
  if (has_others_) {
    shading_.accel.intersect(*others_, batch.rays, rest, Coherence::incoherent);
  } else {
    std::fill(rest.instance.begin(), rest.instance.end(), k_none);
  }
  std::vector<Layer> layers;
  for (size_t j = 0; j < asked.size(); ++j) {
    const uint32_t i = asked[j];
    layers.clear();
    bool refused = false;
    for (const LobeAnswers& a : answers) {
      refused = refused || a.refused[j] != 0;
      if (a.clear[j] < 1.0f) layers.push_back({a.distance[j], &a});
    }
    if (refused) {
      exact.push_back(i);
      continue;
    }
    const float end = rest.instance[j] == k_none ? k_infinity : rest.t[j];
    results.clear[i] = compose(layers, j, end, results.arriving[i]);
    copy_hit(rest, j, results.hits, i);
    if (results.clear[i] < k_least_share) {
      results.clear[i] = 0.0f;
      results.hits.instance[i] = k_none;
    }
  }
  stats.rays_glossy_exact += exact.size();
  if (exact.empty()) return;
  RayBatch traced;
  traced.resize(exact.size());
  for (size_t j = 0; j < exact.size(); ++j) copy_ray(rays, exact[j], traced, j);
  HitBatch found;
  found.resize(exact.size());
  shading_.accel.intersect(traced, found, Coherence::incoherent);
  for (size_t j = 0; j < exact.size(); ++j) copy_hit(found, j, results.hits, exact[j]);
}

}  // namespace fieldtrace
