// The kernels as loops over warps, by the functions that kernels.cu calls, or by the batch loops of the scalar look-ups
// around these.
#include <algorithm>
#include <bit>

#include "core/light/light_sampling.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/query/segment_batch-inl.h"
#include "gpu/device_arguments.h"
#include "gpu/emulated.h"

namespace fieldtrace::gpu {
namespace {

const uint32_t k_first_block[] = {0};

template <class Wanted>
uint32_t mask_of(const Wanted& wanted) {
  uint32_t mask = 0;
  for (uint32_t lane = 0; lane < k_warp; ++lane) mask |= uint32_t(bool(wanted(lane))) << lane;
  return mask;
}

template <class T, class U>
void load(const T* from, U& to) {
  std::copy_n(from, k_warp, to.data());
}

void load_rays(const RayArrays& from, uint32_t first, RayBatch& rays) {
  rays.resize(k_warp);
  load(from.ox + first, rays.ox), load(from.oy + first, rays.oy), load(from.oz + first, rays.oz);
  load(from.dx + first, rays.dx), load(from.dy + first, rays.dy), load(from.dz + first, rays.dz);
  load(from.tmax + first, rays.tmax);
}

// A warp's words for what it lacks, none named yet.
uint32_t* blank_words(uint32_t* missing, uint32_t warp) {
  return std::fill_n(missing + warp * k_missing_words, k_missing_words, k_nothing) - k_missing_words;
}

// Names slices or tiles in a warp's words from `at` on; returns the next free one.
uint32_t name_missing(MissingKind kind, std::vector<uint32_t>& numbers, uint32_t* words, uint32_t at) {
  for (const uint32_t number : numbers) {
    if (at < k_missing_words) words[at++] = missing_word(kind, number);
  }
  numbers.clear();
  return at;
}

void light_cones(const ConeArguments& a) {
  ShadingPointBatch p;
  p.resize(k_warp);
  ConeUnknowns unknowns;
  int32_t flags[k_warp];
  const Sphere light = {{a.light_centre[0], a.light_centre[1], a.light_centre[2]}, a.light_radius};
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    const uint32_t first = a.blocks[warp], wanted = a.wanted[warp];
    load(a.points.px + first, p.px), load(a.points.py + first, p.py), load(a.points.pz + first, p.pz);
    load(a.points.gx + first, p.gx), load(a.points.gy + first, p.gy), load(a.points.gz + first, p.gz);
    load(a.points.error + first, p.error), load(a.points.radius + first, p.radius);
    load(a.points.instance + first, p.instance);
    for (uint32_t lane = 0; lane < k_warp; ++lane) {
      p.transmits[lane] = uint8_t(a.points.transmits[first / k_warp] >> lane & 1u);
      flags[lane] = wanted >> lane & 1u ? k_may_shadow : 0;
    }
    const ConeCounts counts = scalar::light_cones_batch<float>(a.task, p, light, k_first_block, flags, unknowns);
    const auto queried = [&](uint32_t lane) { return (wanted >> lane & 1u) != 0; };
    ConeMasks& m = a.masks[warp];
    m.lookups = uint32_t(counts.lookups);
    m.not_baked = unknowns.blocks.empty() ? 0 : k_all_lanes;
    m.clear = mask_of([&](uint32_t lane) { return queried(lane) && flags[lane] == 0; });
    m.blocked = mask_of([&](uint32_t lane) { return queried(lane) && flags[lane] == k_light_blocked; });
    m.by_strata = mask_of([&](uint32_t lane) { return queried(lane) && flags[lane] & k_by_strata; });
    uint32_t* const words = blank_words(a.missing, warp);
    const uint32_t next = name_missing(MissingKind::tile, unknowns.tiles, words, 0);
    name_missing(MissingKind::depth, unknowns.slices, words, next);
    unknowns.blocks.clear();
  }
}

void filter_strata(const StratumArguments& a) {
  RayBatch rays;
  ConeUnknowns unknowns;
  alignas(k_cache_line) float pdf[k_warp], radius[k_warp], clear[k_warp];
  alignas(k_cache_line) int32_t wanted[k_warp], refused[k_warp];
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    const uint32_t first = a.blocks[warp];
    load_rays(a.rays, first, rays);
    std::copy_n(a.pdf + first, k_warp, pdf);
    std::copy_n(a.radius + first, k_warp, radius);
    for (uint32_t lane = 0; lane < k_warp; ++lane) wanted[lane] = int32_t(a.wanted[warp] >> lane & 1u);
    std::fill_n(clear, k_warp, 1.0f);
    std::fill_n(refused, k_warp, 0);
    ShareMasks& m = a.masks[warp];
    m.lookups = uint32_t(
        scalar::filter_strata_batch<float>(a.task, rays, pdf, radius, wanted, k_first_block, clear, refused, unknowns));
    m.not_baked = unknowns.blocks.empty() ? 0 : k_all_lanes;
    m.refused = mask_of([&](uint32_t lane) { return refused[lane]; });
    std::copy_n(clear, k_warp, a.clear + warp * k_warp);
    uint32_t* const words = blank_words(a.missing, warp);
    name_missing(MissingKind::tile, unknowns.tiles, words, 0);
    unknowns.blocks.clear();
  }
}

// Ray by ray, as the kernel does: the CPU's batches run its steps one after another over many rays.
void query(const QueryArguments& a) {
  const RayArrays& r = a.rays;
  int32_t verdicts[k_warp];
  std::vector<uint32_t> visibility, depth;
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    RayMasks& m = a.masks[warp];
    m.lookups = 0;
    for (uint32_t lane = 0; lane < k_warp; ++lane) {
      const uint32_t i = a.blocks[warp] + lane;
      const scalar::SegmentVerdict<float> answer =
          scalar::answer_segment<float>(a.task, {r.ox[i], r.oy[i], r.oz[i]}, {r.dx[i], r.dy[i], r.dz[i]}, r.tmax[i],
                                        a.instance[i] == a.task.instance);
      verdicts[lane] = answer.verdict;
      m.lookups += uint32_t(answer.lookups);
      if (answer.verdict == scalar::k_verdict_unknown_visibility) visibility.push_back(uint32_t(answer.slice));
      if (answer.verdict == scalar::k_verdict_unknown_depth) depth.push_back(uint32_t(answer.slice));
    }
    const auto lanes_with = [&](int32_t verdict) {
      return mask_of([&](uint32_t lane) { return verdicts[lane] == verdict; });
    };
    m.not_baked = visibility.empty() && depth.empty() ? 0 : k_all_lanes;
    m.crosses = ~lanes_with(scalar::k_verdict_none);
    m.blocked = lanes_with(scalar::k_verdict_blocked);
    m.undecided = lanes_with(scalar::k_verdict_undecided);
    uint32_t* const words = blank_words(a.missing, warp);
    const uint32_t next = name_missing(MissingKind::visibility, visibility, words, 0);
    name_missing(MissingKind::depth, depth, words, next);
  }
}

void filter_lobes(const LobeArguments& a) {
  LobeBatch lobes;
  lobes.resize(k_warp);
  LobeAnswers answers;
  answers.resize(k_warp);
  ConeUnknowns unknowns;
  const LobeArrays& from = a.lobes;
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    const uint32_t first = a.blocks[warp];
    load_rays(from.rays, first, lobes.rays);
    load(from.nx + first, lobes.nx), load(from.ny + first, lobes.ny), load(from.nz + first, lobes.nz);
    load(from.density + first, lobes.density), load(from.blur + first, lobes.blur);
    load(from.instance + first, lobes.instance);
    ShareMasks& m = a.masks[warp];
    m.lookups = uint32_t(scalar::filter_lobes_batch<float>(a.task, lobes, k_first_block, answers, unknowns));
    m.not_baked = unknowns.blocks.empty() ? 0 : k_all_lanes;
    m.refused = mask_of([&](uint32_t lane) { return answers.refused[lane]; });
    const std::pair<const AlignedVector<float>*, float*> values[] = {{&answers.clear, a.clear},
                                                                     {&answers.red, a.red},
                                                                     {&answers.green, a.green},
                                                                     {&answers.blue, a.blue},
                                                                     {&answers.distance, a.distance}};
    for (const auto& [of, to] : values) std::copy_n(of->data(), k_warp, to + warp * k_warp);
    name_missing(MissingKind::tile, unknowns.tiles, blank_words(a.missing, warp), 0);
    unknowns.blocks.clear();
  }
}

// The tables that the light needs, as far as it reads them.
LightTable table_of(const LightRayArguments& a) {
  LightTable table;
  table.lights.resize(a.light_index + 1);
  table.lights[a.light_index] = a.light;
  const LightTables& from = a.tables;
  if (a.range.columns == 0) table.point_sets.assign(from.point_sets, from.point_sets + k_point_sets * k_set_words);
  if (a.light.kind == LightKind::mesh) {
    table.triangles.assign(from.triangles, from.triangles + a.light.first_triangle + a.light.triangle_count);
  }
  if (a.light.kind == LightKind::environment) {
    const size_t width = a.light.width, height = a.light.height;
    table.environment.rows.assign(from.rows, from.rows + height);
    table.environment.sums.assign(from.sums, from.sums + (width + 1) * height);
    table.environment.texels.assign(from.texels, from.texels + 3 * width * height);
  }
  return table;
}

// The light's samples by the CPU's batch loops, for one shading point after another.
void light_rays(const LightRayArguments& a) {
  const LightTable table = table_of(a);
  const auto points_of = [&](uint32_t r) {
    const ReceiverArrays& from = a.receivers;
    ShadingPointBatch p;
    // If any of them transmits, all are sampled so: the second point stands for it.
    p.resize(a.any_transmits ? 2 : 1);
    for (size_t i = 0; i < p.size; ++i) {
      p.px[i] = from.px[r], p.py[i] = from.py[r], p.pz[i] = from.pz[r];
      p.gx[i] = from.gx[r], p.gy[i] = from.gy[r], p.gz[i] = from.gz[r];
      p.sx[i] = from.sx[r], p.sy[i] = from.sy[r], p.sz[i] = from.sz[r];
      p.error[i] = from.error[r];
      p.seed[i] = from.seed[r], p.sample[i] = from.sample[r], p.instance[i] = from.instance[r];
      p.transmits[i] = i == 1 || (from.transmits[r / k_warp] >> (r % k_warp) & 1u);
    }
    return p;
  };
  const uint32_t count = uint32_t(a.range.count);
  ShadowBatch made;
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    const LightRayBlock& block = a.blocks[warp];
    uint32_t made_of = ~0u;
    for (uint32_t lane = 0; lane < k_warp; ++lane) {
      const uint32_t at = warp * k_warp + lane, place = block.first + lane;
      const bool is_slot = place < block.slots;
      const uint32_t slot = is_slot && a.numbers ? a.numbers[at] : place, r = block.point + slot / count;
      if (is_slot && made_of != r) {
        sample_light(table, a.light_index, points_of(r), a.range, Isa::scalar, made);
        made_of = r;
      }
      const AlignedVector<float>* const rays[] = {&made.rays.ox, &made.rays.oy, &made.rays.oz,   &made.rays.dx,
                                                  &made.rays.dy, &made.rays.dz, &made.rays.tmax, &made.pdf};
      float* const to[] = {a.ox, a.oy, a.oz, a.dx, a.dy, a.dz, a.tmax, a.pdf};
      for (int i = 0; i < 8; ++i)
        to[i][at] = is_slot ? (*rays[i])[slot % count] : i == 5 ? 1.0f : i == 6 ? -1.0f : 0.0f;
      a.radius[at] = is_slot ? a.receivers.radius[r] : 0.0f;
      a.instance[at] = is_slot ? a.receivers.instance[r] : ~0u;
    }
  }
}

void sky_cells(const SkyArguments& a) {
  int32_t listed[2 * k_warp];
  for (uint32_t warp = 0; warp < a.warps; ++warp) {
    const SkyBlock& block = a.blocks[warp];
    const uint32_t i = warp * k_warp;
    const CellPoints& p = a.points;
    const CellPoints points = {p.px + i, p.py + i, p.pz + i, p.gx + i,        p.gy + i,     p.gz + i,
                               p.sx + i, p.sy + i, p.sz + i, int32_t(k_warp), block.grazing};
    const CellSums& s = a.sums;
    const CellSums sums = {s.red + i,           s.green + i,           s.blue + i,
                           s.reflected_red + i, s.reflected_green + i, s.reflected_blue + i};
    for (float* sum :
         {sums.red, sums.green, sums.blue, sums.reflected_red, sums.reflected_green, sums.reflected_blue}) {
      std::fill_n(sum, k_warp, 0.0f);
    }
    for (uint32_t k = 0; k < block.cells; ++k) {
      const int count = scalar::see_cell<float>(a.tasks[block.first_task + k], points, sums, listed);
      uint32_t mask = 0;
      for (int l = 0; l < count; ++l) mask |= 1u << uint32_t(listed[l]);
      a.undecided[block.undecided + k] = mask;
    }
  }
}

void scatter(const ScatterArguments& a) {
  for (uint32_t run = 0; run < a.warps; ++run) {
    const ScatterRun& r = a.runs[run];
    std::copy_n(a.packet + r.from, r.words, std::bit_cast<uint32_t*>(r.to));
  }
}

}  // namespace

void run_emulated_kernel(Kernel kernel, uint32_t, const void* arguments) {
  switch (kernel) {
    case Kernel::light_cones:
      return light_cones(*static_cast<const ConeArguments*>(arguments));
    case Kernel::filter_strata:
      return filter_strata(*static_cast<const StratumArguments*>(arguments));
    case Kernel::query:
      return query(*static_cast<const QueryArguments*>(arguments));
    case Kernel::light_rays:
      return light_rays(*static_cast<const LightRayArguments*>(arguments));
    case Kernel::sky_cells:
      return sky_cells(*static_cast<const SkyArguments*>(arguments));
    case Kernel::filter_lobes:
      return filter_lobes(*static_cast<const LobeArguments*>(arguments));
    case Kernel::scatter:
      return scatter(*static_cast<const ScatterArguments*>(arguments));
  }
}

}  // namespace fieldtrace::gpu
