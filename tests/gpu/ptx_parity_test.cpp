// The kernels' PTX gives the answers of the CPU's kernels, scalar and SIMD, bit for bit: more than a million entries
// each, of which many hold extreme values, over fields of which all, most or none is baked. Cells of skies:
// ptx_sky_parity_test.cpp.
#include <gtest/gtest.h>

#include <array>
#include <set>

#include "core/light/light_sampling.h"
#include "core/simd/isa.h"
#include "gpu/device_arguments.h"
#include "gpu/runtime.h"
#include "tests/gpu/ask_device.h"
#include "tests/gpu/ptx_variants.h"
#include "tests/support/light_test_scenes.h"

namespace fieldtrace::gpu {
namespace {

// ---- the CPU's answers about one warp

struct WarpAnswers {
  bool not_baked = false;
  uint32_t lookups = 0;
  uint32_t masks[3] = {};
  std::vector<float> clear = {};
  std::set<uint32_t> missing = {};
  bool is_full = false;  // some lane met more than it has room for
};

template <class Wanted>
uint32_t mask_of(const Wanted& wanted) {
  uint32_t mask = 0;
  for (uint32_t lane = 0; lane < k_warp; ++lane) mask |= uint32_t(bool(wanted(lane))) << lane;
  return mask;
}

void add_words(MissingKind kind, const std::vector<uint32_t>& numbers, std::set<uint32_t>& words) {
  for (const uint32_t n : numbers) words.insert(missing_word(kind, n));
}

void expect_equal(const WarpAnswers& gpu, const WarpAnswers& cpu, const std::string& name) {
  ASSERT_EQ(gpu.not_baked, cpu.not_baked) << name;
  if (!cpu.not_baked) {
    ASSERT_EQ(gpu.lookups, cpu.lookups) << name;
    for (int m = 0; m < 3; ++m) ASSERT_EQ(gpu.masks[m], cpu.masks[m]) << name << ", mask " << m;
    for (size_t l = 0; l < cpu.clear.size(); ++l) {
      const bool both_nan = std::isnan(gpu.clear[l]) && std::isnan(cpu.clear[l]);
      ASSERT_TRUE(both_nan || std::bit_cast<uint32_t>(gpu.clear[l]) == std::bit_cast<uint32_t>(cpu.clear[l]))
          << name << ", lane " << l << ": " << gpu.clear[l] << " and " << cpu.clear[l];
    }
    return;
  }
  if (!gpu.is_full) {
    ASSERT_EQ(gpu.missing, cpu.missing) << name;
  }
  for (const uint32_t word : gpu.missing) ASSERT_TRUE(cpu.missing.count(word)) << name;
}

// What a kernel wrote, set to garbage first.
template <class Masks>
struct Outputs {
  explicit Outputs(size_t warps) : masks(warps), missing(warps * k_missing_words, 0xcdcdcdcdu) {
    std::memset(masks.data(), 0xcd, warps * sizeof(Masks));
  }
  // The words of the warp; sets is_full where a lane had no room for more.
  std::set<uint32_t> words_of(size_t warp, bool& is_full) const {
    std::set<uint32_t> words;
    for (uint32_t i = 0; i < k_missing_words; ++i) {
      const uint32_t word = missing[warp * k_missing_words + i];
      if (word != k_nothing) words.insert(word);
      is_full = is_full || (word != k_nothing && i % 4 == 3);
    }
    return words;
  }
  std::vector<Masks> masks;
  std::vector<uint32_t> missing;
};

class PtxParity : public ::testing::Test {
 protected:
  PtxParity() : random_(7) {
    add_field({32, 64}, 1.0f);
    add_field({32, 128}, 0.995f);
    add_field({32, 64}, 0.0f);
    for (const Isa isa : {Isa::scalar, resolve_isa(Isa::automatic)}) tables_.push_back(&segment_kernels(isa));
  }
  void add_field(const FieldParameters& parameters, float baked) {
    fields_.push_back(std::make_unique<RandomField>(parameters, baked, random_));
  }
  // The empty one rarely: it only says what is missing.
  const RandomField& any_field() { return *fields_[random_.index(16) == 0 ? 2 : random_.index(4) == 0 ? 1 : 0]; }

  static RayArrays arrays_of(const RayBatch& r) {
    return {r.ox.data(), r.oy.data(), r.oz.data(), r.dx.data(), r.dy.data(), r.dz.data(), r.tmax.data()};
  }

  TestRandom random_;
  std::vector<std::unique_ptr<RandomField>> fields_;
  std::vector<const SegmentKernels*> tables_;
};

TEST(PtxKernels, TheCompilerMadeNothingThatRoundsOtherwise) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for (const std::string& refusal : ptx::ptx_refusals()) ADD_FAILURE() << refusal;
  EXPECT_GE(ptx::ptx_kernels().size(), size_t(k_kernels));
}

TEST_F(PtxParity, Query) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for_each_variant<QueryArguments>("query", [&](const auto& launch, const std::string& targets) {
    Values values(1);
    size_t entries = 0, verdicts[3] = {}, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      const QueryInputs inputs(l, values);
      const auto& [rays, instances] = inputs;
      Outputs<RayMasks> out(l.warps);
      const std::vector<uint32_t> blocks = blocks_of(l.entries);
      launch({l.task, arrays_of(rays), instances.data(), blocks.data(), out.masks.data(), out.missing.data(),
              uint32_t(l.warps)});
      for (const SegmentKernels* table : tables_) {
        RayStates states;
        states.keep_verdicts = true;
        states.reset(l.entries);
        for (size_t warp = 0; warp < l.warps; ++warp) {
          const size_t first = warp * k_warp;
          const SegmentCounts counts = table->query(l.task, rays, instances.data(), first, first + k_warp, 0, states);
          const auto verdict = [&](int32_t wanted) {
            return mask_of([&](uint32_t lane) { return states.verdict[first + lane] == wanted; });
          };
          WarpAnswers cpu = {!states.unknown_blocks.empty(),
                             uint32_t(counts.lookups),
                             {~verdict(scalar::k_verdict_none), verdict(scalar::k_verdict_blocked),
                              verdict(scalar::k_verdict_undecided)},
                             {}};
          add_words(MissingKind::visibility, states.unknown_visibility, cpu.missing);
          add_words(MissingKind::depth, states.unknown_depth, cpu.missing);
          const RayMasks& m = out.masks[warp];
          ASSERT_TRUE(m.not_baked == 0 || m.not_baked == k_all_lanes);
          WarpAnswers gpu = {m.not_baked != 0, m.lookups, {m.crosses, m.blocked, m.undecided}, {}, {}};
          if (gpu.not_baked) gpu.missing = out.words_of(warp, gpu.is_full);
          expect_equal(gpu, cpu, targets);
          if (HasFatalFailure()) return;
          not_baked += gpu.not_baked;
          for (int i = 0; i < 3; ++i) verdicts[i] += size_t(std::popcount(gpu.masks[i]));
          states.unknown_blocks.clear(), states.unknown_visibility.clear(), states.unknown_depth.clear();
        }
      }
      entries += l.entries;
    }
    for (const size_t n : verdicts) EXPECT_GT(n, entries / 50);
    EXPECT_GT(not_baked, 1000u);
    EXPECT_LT(not_baked, entries / 64);
  });
}

TEST_F(PtxParity, FilterStrata) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for_each_variant<StratumArguments>("filter_strata", [&](const auto& launch, const std::string& targets) {
    Values values(2);
    size_t entries = 0, partial = 0, dark = 0, refused = 0, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      const StratumInputs inputs(l, values);
      const auto& [task, rays, pdf, radius, wanted] = inputs;
      Outputs<ShareMasks> out(l.warps);
      std::vector<float> shares(padded(l.entries), -1.0f);
      const std::vector<uint32_t> all = blocks_of(l.entries);
      std::vector<uint32_t> asked;
      for (const uint32_t b : all) asked.push_back(wanted_mask(b, [&w = wanted](uint32_t i) { return w[i] != 0; }));
      launch({task, arrays_of(rays), pdf.data(), radius.data(), all.data(), asked.data(), shares.data(),
              out.masks.data(), out.missing.data(), uint32_t(l.warps)});
      for (const SegmentKernels* table : tables_) {
        AlignedVector<float> clear(padded(l.entries), 1.0f);
        AlignedVector<int32_t> failed(padded(l.entries), 0);
        for (size_t warp = 0; warp < l.warps; ++warp) {
          const uint32_t first = uint32_t(warp * k_warp);
          const std::array<uint32_t, 1> blocks = {first};
          ConeUnknowns unknowns;
          const uint64_t lookups = table->filter_strata(task, rays, pdf.data(), radius.data(), wanted.data(), blocks,
                                                        clear.data(), failed.data(), unknowns);
          WarpAnswers cpu = {!unknowns.blocks.empty(),
                             uint32_t(lookups),
                             {mask_of([&](uint32_t lane) { return failed[first + lane] != 0; })},
                             {clear.begin() + first, clear.begin() + first + k_warp},
                             {}};
          add_words(MissingKind::tile, unknowns.tiles, cpu.missing);
          const ShareMasks& m = out.masks[warp];
          ASSERT_TRUE(m.not_baked == 0 || m.not_baked == k_all_lanes);
          WarpAnswers gpu = {
              m.not_baked != 0, m.lookups, {m.refused}, {shares.begin() + first, shares.begin() + first + k_warp}, {}};
          if (gpu.not_baked) gpu.missing = out.words_of(warp, gpu.is_full);
          expect_equal(gpu, cpu, targets);
          if (HasFatalFailure()) return;
          not_baked += gpu.not_baked;
          if (gpu.not_baked) continue;
          refused += size_t(std::popcount(m.refused));
          for (const float c : gpu.clear) partial += c > 0.0f && c < 1.0f, dark += c == 0.0f;
        }
      }
      entries += l.entries;
    }
    for (const size_t n : {partial, dark, refused}) EXPECT_GT(n, entries / 50);
    EXPECT_GT(not_baked, 1000u);
    EXPECT_LT(not_baked, entries / 64);
  });
}

TEST_F(PtxParity, LightCones) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for_each_variant<ConeArguments>("light_cones", [&](const auto& launch, const std::string& targets) {
    Values values(3);
    size_t entries = 0, counts[3] = {}, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      const ConeInputs inputs(l, values);
      const ConeTask& task = inputs.task;
      const Sphere& light = inputs.light;
      const ShadingPointBatch& points = inputs.points;
      const AlignedVector<int32_t>& flags = inputs.flags;
      const std::vector<uint32_t> all = blocks_of(l.entries);
      std::vector<uint32_t> transmits, wanted;
      for (const uint32_t b : all) {
        transmits.push_back(wanted_mask(b, [&](uint32_t i) { return points.transmits[i] != 0; }));
        wanted.push_back(wanted_mask(b, [&](uint32_t i) { return (flags[i] & k_may_shadow) != 0; }));
      }
      Outputs<ConeMasks> out(l.warps);
      ConeArguments a = {
          task,
          {light.centre.x, light.centre.y, light.centre.z},
          light.radius,
          {points.px.data(), points.py.data(), points.pz.data(), points.gx.data(), points.gy.data(), points.gz.data(),
           points.error.data(), points.radius.data(), points.instance.data(), transmits.data()},
          all.data(),
          wanted.data(),
          out.masks.data(),
          out.missing.data(),
          uint32_t(l.warps)};
      launch(a);
      for (const SegmentKernels* table : tables_) {
        AlignedVector<int32_t> found = flags;
        for (size_t warp = 0; warp < l.warps; ++warp) {
          const uint32_t first = uint32_t(warp * k_warp);
          const std::array<uint32_t, 1> blocks = {first};
          ConeUnknowns unknowns;
          const ConeCounts c = table->light_cones(task, points, light, blocks, found.data(), unknowns);
          const ConeMasks& m = out.masks[warp];
          ASSERT_TRUE(m.not_baked == 0 || m.not_baked == k_all_lanes);
          // The flags that the masks make of the old ones (hybrid/visibility/device_answers.cpp) must be the CPU's.
          const auto flag = [&](uint32_t lane) {
            int32_t f = flags[first + lane];
            if (m.by_strata >> lane & 1u) f |= k_by_strata;
            if (m.clear >> lane & 1u) f = 0;
            if (m.blocked >> lane & 1u) f = k_light_blocked;
            return f;
          };
          if (!m.not_baked) {
            ASSERT_EQ(c.clear, uint64_t(std::popcount(m.clear)));
            ASSERT_EQ(c.blocked, uint64_t(std::popcount(m.blocked)));
            ASSERT_EQ(mask_of([&](uint32_t lane) { return flag(lane) != found[first + lane]; }), 0u) << targets;
            counts[0] += c.clear, counts[1] += c.blocked, counts[2] += size_t(std::popcount(m.by_strata));
          }
          WarpAnswers cpu = {!unknowns.blocks.empty(), uint32_t(c.lookups), {}, {}, {}};
          add_words(MissingKind::tile, unknowns.tiles, cpu.missing);
          add_words(MissingKind::depth, unknowns.slices, cpu.missing);
          WarpAnswers gpu = {m.not_baked != 0, m.lookups, {}, {}, {}};
          if (gpu.not_baked) gpu.missing = out.words_of(warp, gpu.is_full);
          expect_equal(gpu, cpu, targets);
          if (HasFatalFailure()) return;
          not_baked += gpu.not_baked;
        }
      }
      entries += l.entries;
    }
    for (const size_t n : counts) EXPECT_GT(n, entries / 100);
    EXPECT_GT(not_baked, 1000u);
    EXPECT_LT(not_baked, entries / 64);
  });
}

TEST_F(PtxParity, FilterLobes) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  const RandomMaps whole(16, 32, 1.0f, random_), most(16, 32, 0.995f, random_), none(16, 32, 0.0f, random_);
  for_each_variant<LobeArguments>("filter_lobes", [&](const auto& launch, const std::string& targets) {
    Values values(7);
    size_t entries = 0, partial = 0, dark = 0, bright = 0, refused = 0, not_baked = 0;
    while (entries < k_least_entries) {
      const uint32_t which = values.random.index(64);
      const Launch l = random_launch((which == 0 ? none : which < 16 ? most : whole).view(), values);
      const LobeInputs inputs(l, values);
      const LobeBatch& in = inputs.lobes;
      Outputs<ShareMasks> out(l.warps);
      std::vector<float> found[k_lobe_values];
      for (auto& f : found) f.assign(padded(l.entries), -7.0f);
      const std::vector<uint32_t> all = blocks_of(l.entries);
      launch({inputs.task,
              {arrays_of(in.rays), in.nx.data(), in.ny.data(), in.nz.data(), in.density.data(), in.blur.data(),
               in.instance.data()},
              all.data(),
              found[0].data(),
              found[1].data(),
              found[2].data(),
              found[3].data(),
              found[4].data(),
              out.masks.data(),
              out.missing.data(),
              uint32_t(l.warps)});
      for (const SegmentKernels* table : tables_) {
        LobeAnswers answers;
        answers.resize(l.entries);
        const AlignedVector<float>* const expected[] = {&answers.clear, &answers.red, &answers.green, &answers.blue,
                                                        &answers.distance};
        for (size_t warp = 0; warp < l.warps; ++warp) {
          const uint32_t first = uint32_t(warp * k_warp);
          const std::array<uint32_t, 1> blocks = {first};
          ConeUnknowns unknowns;
          const uint64_t lookups = table->filter_lobes(inputs.task, in, blocks, answers, unknowns);
          WarpAnswers cpu = {!unknowns.blocks.empty(),
                             uint32_t(lookups),
                             {mask_of([&](uint32_t lane) { return answers.refused[first + lane] != 0; })},
                             {},
                             {}};
          const ShareMasks& m = out.masks[warp];
          ASSERT_TRUE(m.not_baked == 0 || m.not_baked == k_all_lanes);
          WarpAnswers gpu = {m.not_baked != 0, m.lookups, {m.refused}, {}, {}};
          for (size_t v = 0; v < k_lobe_values; ++v) {
            cpu.clear.insert(cpu.clear.end(), expected[v]->begin() + first, expected[v]->begin() + first + k_warp);
            gpu.clear.insert(gpu.clear.end(), found[v].begin() + first, found[v].begin() + first + k_warp);
          }
          add_words(MissingKind::tile, unknowns.tiles, cpu.missing);
          if (gpu.not_baked) gpu.missing = out.words_of(warp, gpu.is_full);
          expect_equal(gpu, cpu, targets);
          if (HasFatalFailure()) return;
          not_baked += gpu.not_baked;
          if (gpu.not_baked) continue;
          refused += size_t(std::popcount(m.refused));
          for (size_t lane = 0; lane < k_warp; ++lane) {
            const float c = gpu.clear[lane];
            partial += c > 0.0f && c<1.0f, dark += c == 0.0f, bright += gpu.clear[2 * k_warp + lane]> 0.0f;
          }
        }
      }
      entries += l.entries;
    }
    for (const size_t n : {partial, dark, bright, refused}) EXPECT_GT(n, entries / 50);
    EXPECT_GT(not_baked, 1000u);
    EXPECT_LT(not_baked, entries / 64);
  });
}

// A light of a random kind, with its tables, at times with extreme values.
LightTable random_light(Values& values) {
  using namespace light_test;
  TestRandom& random = values.random;
  std::mt19937 turns(random.index(1u << 30));
  DMat3 axes = random_rotation(turns);
  const double size = random.log_uniform(1e-3f, 1e2f);
  const bool is_similar = random.index(2) == 0;
  for (int i = 0; i < 3; ++i) axes[i] *= size * (is_similar ? 1.0 : double(random.log_uniform(0.1f, 1.0f)));
  if (random.index(4) == 0) axes[0] += 0.3 * axes[1];
  const Vec3 at = float(size) * 5.0f * random.in_ball();
  const DAffine to_world = affine(axes[0], axes[1], axes[2], DVec3(at));
  const bool flip = random.index(2) == 0;
  constexpr ShapeKind k_shapes[] = {ShapeKind::sphere, ShapeKind::rectangle, ShapeKind::disk, ShapeKind::cylinder};
  constexpr EmitterKind k_emitters[] = {EmitterKind::point, EmitterKind::directional, EmitterKind::constant};
  const uint32_t kind = random.index(10) % 9;  // spheres more often: only some of them are of the kind `sphere`
  const Scene scene = kind < 4    ? area_scene(k_shapes[kind], to_world, flip)
                      : kind < 7  ? emitter_scene(k_emitters[kind - 4])
                      : kind == 7 ? area_scene(mesh_shape(), to_world, flip)
                                  : environment_scene(9, 7, spotted_texel, Mat3(random_rotation(turns)));
  LightTable table = make_lights(scene);
  table.point_sets = make_point_sets();
  Light& light = table.lights[0];
  float* const groups[] = {light.centre,         light.axis[0],        light.axis[1],        light.axis[2],
                           light.normal_axis[0], light.normal_axis[1], light.normal_axis[2], light.normal,
                           light.unit_axis[0],   light.unit_axis[1]};
  for (float* group : groups) {
    for (int i = 0; i < 3; ++i) group[i] = values.spoilt(group[i]);
  }
  for (float* f :
       {&light.half_size[0], &light.half_size[1], &light.radius, &light.area, &light.error_base, &light.error_slope}) {
    *f = values.spoilt(*f);
  }
  return table;
}

LightSampleRange random_range(TestRandom& random) {
  if (random.index(3) == 0) {
    const int columns = 1 + int(random.index(8)), rows = 2 + int(random.index(8)), total = columns * rows;
    return {total, 0, total, columns};
  }
  const int total = 1 + int(random.index(random.index(4) == 0 ? 300 : 20)), first = int(random.index(uint32_t(total)));
  return {total, first, 1 + int(random.index(uint32_t(total - first)))};
}

ShadingPointBatch random_points(size_t size, const Light& light, Values& values) {
  TestRandom& random = values.random;
  ShadingPointBatch points;
  points.resize(size);
  for (size_t i = 0; i < size; ++i) {
    const Vec3 centre(light.centre[0], light.centre[1], light.centre[2]);
    const Vec3 p = values.spoilt(centre + random.log_uniform(1e-3f, 1e3f) * random.direction());
    const Vec3 g = values.spoilt(random.direction()), s = values.spoilt(random.direction());
    points.px[i] = p.x, points.py[i] = p.y, points.pz[i] = p.z;
    points.gx[i] = g.x, points.gy[i] = g.y, points.gz[i] = g.z;
    points.sx[i] = s.x, points.sy[i] = s.y, points.sz[i] = s.z;
    points.error[i] = values.spoilt(random.log_uniform(1e-9f, 1e-2f));
    points.radius[i] = values.spoilt(random.uniform());
    points.seed[i] = random.index(0xffffffffu);
    points.sample[i] = random.index(random.index(2) == 0 ? 16 : 1u << 20);
    points.instance[i] = random.index(5);
    points.transmits[i] = 0;
  }
  return points;
}

TEST_F(PtxParity, LightRays) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for_each_variant<LightRayArguments>("light_rays", [&](const auto& launch, const std::string& targets) {
    Values values(5);
    TestRandom& random = values.random;
    size_t slots = 0, active = 0, by_number = 0, transmitting = 0, below = 0, sideless = 0, kinds[13] = {};
    while (slots < k_least_entries) {
      const bool transmits = random.index(3) == 0;
      values.wild = random.index(4) == 0 ? 0.1f : 0.0f;
      const uint32_t index = random.index(4);
      LightTable table = random_light(values);
      const Light light = table.lights[0];
      table.lights.assign(4, {});
      table.lights[index] = light;
      if (light.kind == LightKind::none) continue;
      LightSampleRange range = random_range(random);
      if (light.kind == LightKind::mesh) range.columns = 0;
      ShadingPointBatch points = random_points(1 + random.index(200), light, values);
      for (size_t i = 0; transmits && i < points.size; ++i) points.transmits[i] = uint8_t(random.index(2));
      points.transmits[0] = uint8_t(transmits);
      std::vector<uint32_t> transmit_masks;
      for (const uint32_t b : blocks_of(points.size)) {
        transmit_masks.push_back(wanted_mask(b, [&](uint32_t i) { return i < points.size && points.transmits[i]; }));
      }
      const size_t count = size_t(range.count), size = points.size * count;
      // All slots, or some of them anywhere.
      std::vector<uint32_t> numbers(padded(size), 0u);
      const bool has_numbers = random.index(2) == 0;
      for (uint32_t i = 0; i < size; ++i) numbers[i] = has_numbers ? random.index(uint32_t(size)) : i;
      std::vector<LightRayBlock> blocks;
      for (const uint32_t b : blocks_of(size)) blocks.push_back({0, b, uint32_t(size)});
      std::vector<float> made[9];
      for (auto& m : made) m.assign(numbers.size(), -7.0f);
      std::vector<uint32_t> instance(numbers.size(), 99u);
      const ShadingPointBatch& p = points;
      launch({light,
              index,
              range,
              transmits,
              {p.px.data(), p.py.data(), p.pz.data(), p.gx.data(), p.gy.data(), p.gz.data(), p.sx.data(), p.sy.data(),
               p.sz.data(), p.error.data(), p.radius.data(), p.seed.data(), p.sample.data(), p.instance.data(),
               transmit_masks.data()},
              {range.columns > 0 ? nullptr : table.point_sets.data(), table.triangles.data(),
               table.environment.rows.data(), table.environment.sums.data(), table.environment.texels.data()},
              blocks.data(),
              has_numbers ? numbers.data() : nullptr,
              made[0].data(),
              made[1].data(),
              made[2].data(),
              made[3].data(),
              made[4].data(),
              made[5].data(),
              made[6].data(),
              made[7].data(),
              made[8].data(),
              instance.data(),
              uint32_t(blocks.size())});
      for (const Isa isa : {Isa::scalar, resolve_isa(Isa::automatic)}) {
        ShadowBatch cpu;
        sample_light(table, index, points, range, isa, cpu);
        const AlignedVector<float>* const rays[] = {&cpu.rays.ox, &cpu.rays.oy, &cpu.rays.oz,   &cpu.rays.dx,
                                                    &cpu.rays.dy, &cpu.rays.dz, &cpu.rays.tmax, &cpu.pdf};
        for (size_t at = 0; at < instance.size(); ++at) {
          const size_t slot = numbers[at], r = slot / count;
          if (at >= size) {
            ASSERT_LT(made[6][at], 0.0f);
            continue;
          }
          // The side of a point that transmits is the sign of a cosine, which NaN has on a CPU alone.
          const Vec3 g(points.gx[r], points.gy[r], points.gz[r]), d = cpu.rays.direction(slot);
          const float cosine = glm::dot(g, d) + glm::dot(Vec3(points.sx[r], points.sy[r], points.sz[r]), d);
          const bool has_side = !points.transmits[r] || (cpu.rays.tmax[slot] >= 0.0f && !std::isnan(cosine));
          sideless += !has_side;
          below += points.transmits[r] && cpu.rays.tmax[slot] >= 0.0f && glm::dot(g, d) < 0.0f;
          for (int i = 0; i < 8; ++i) {
            if (!has_side && values.wild > 0.0f) break;
            const float a = made[i][at], b = (*rays[i])[slot];
            ASSERT_TRUE((std::isnan(a) && std::isnan(b)) || std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b))
                << targets << ", kind " << int(light.kind) << ", array " << i << ": " << a << " and " << b;
          }
          active += made[6][at] >= 0.0f;
          ASSERT_EQ(instance[at], points.instance[r]);
          ASSERT_EQ(std::bit_cast<uint32_t>(made[8][at]), std::bit_cast<uint32_t>(points.radius[r]));
        }
      }
      slots += instance.size();
      by_number += has_numbers ? instance.size() : 0;
      transmitting += transmits ? instance.size() : 0;
      kinds[int(light.kind)] += instance.size();
    }
    for (const LightKind kind :
         {LightKind::sphere, LightKind::sphere_inside, LightKind::rectangle, LightKind::parallelogram, LightKind::disk,
          LightKind::ellipsoid, LightKind::cylinder, LightKind::mesh, LightKind::point, LightKind::directional,
          LightKind::constant, LightKind::environment}) {
      EXPECT_GT(kinds[int(kind)], slots / 100) << int(kind);
    }
    EXPECT_GT(active, slots / 5);  // of both instruction sets
    EXPECT_GT(by_number, slots / 3);
    EXPECT_GT(transmitting, slots / 5);
    EXPECT_GT(below, slots / 20);  // light from below the surface
    EXPECT_LT(sideless, slots / 4);
  });
}

TEST(PtxKernels, Scatter) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  for_each_variant<ScatterArguments>("scatter", [&](const auto& launch, const std::string&) {
    TestRandom random(4);
    size_t copied = 0;
    while (copied < k_least_entries) {
      std::vector<ScatterRun> runs(1 + random.index(300));
      std::vector<uint32_t> packet(1 + random.index(200000)), to(3 * packet.size(), 5), expected = to;
      for (uint32_t& w : packet) w = random.index(0xffffffffu);
      size_t at = 0;
      for (ScatterRun& run : runs) {
        const uint32_t from = random.index(uint32_t(packet.size()));
        uint32_t words = random.index(4) == 0 ? random.index(40) : random.index(2000);
        at += random.index(3);
        words = uint32_t(std::min({size_t(words), packet.size() - from, to.size() - std::min(at, to.size())}));
        if (words == 0) at = std::min(at, to.size() - 1);
        run = {std::bit_cast<uint64_t>(to.data() + at), from, words};
        std::copy_n(packet.data() + from, words, expected.data() + at);
        at += words;
        copied += words;
      }
      launch({runs.data(), packet.data(), uint32_t(runs.size())});
      ASSERT_EQ(to, expected);
    }
  });
}

}  // namespace
}  // namespace fieldtrace::gpu
