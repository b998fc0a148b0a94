// The kernels' PTX gives the answers of the CPU's kernels, scalar and SIMD, bit for bit: more than a million entries
// each, of which many hold extreme values, over fields of which all, most or none is baked.
#include <gtest/gtest.h>

#include <array>
#include <set>

#include "core/simd/isa.h"
#include "field/query/query.hd.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "gpu/device_arguments.h"
#include "tests/gpu/ptx_kernels.h"
#include "tests/support/random_lines.h"

namespace fieldtrace::gpu {
namespace {

constexpr size_t k_least_entries = 1 << 20;
constexpr size_t k_most_entries = 4096;  // of one launch

// ---- fields of random cells

class RandomField {
 public:
  // baked: share of the slices and tiles.
  RandomField(const FieldParameters& parameters, float baked, TestRandom& random)
      : field_(Sphere{Vec3(0.0f), 1.0f}, parameters) {
    for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
      for (uint32_t slice = 0; slice < field_.slice_count(); ++slice) {
        if (random.uniform() < baked) bake(layer, slice, random);
      }
    }
    for (uint32_t slot = 0; slot < field_.coverage().slot_count(); ++slot) {
      if (random.uniform() < baked) bake_tile(slot, random);
    }
  }
  FieldView view() const { return field_.view(); }

 private:
  void bake(FieldLayer layer, uint32_t slice, TestRandom& random) {
    const std::optional<uint32_t> cell = field_.claim(layer, slice);
    if (!cell) return;
    for (uint32_t c = *cell; c < *cell + uint32_t(scalar::k_slice_cells); ++c) {
      if (layer == FieldLayer::visibility) {
        field_.store_visibility(c, uint8_t(1 + random.index(128)));
        continue;
      }
      const uint32_t kind = 1 + random.index(3), risk = random.index(64), error = random.index(256);
      field_.store_plane_fit(c, random.index(0xffffffffu), kind | risk << 2 | error << 8);
    }
    field_.finish(layer, slice);
  }
  // Empty, whole, behind an edge, or noise; at one depth, on a slope, or in two layers.
  void bake_tile(uint32_t slot, TestRandom& random) {
    if (!field_.coverage().claim(slot)) return;
    TileLines lines(CoverageTiles::k_lines_per_tile);
    const uint32_t shape = random.index(6), depths = random.index(4), depth = 1 + random.index(1000);
    const float x = random.uniform(-1, 1), y = random.uniform(-1, 1), edge = random.uniform(-8.0f, 40.0f);
    for (uint32_t i = 0; i < lines.size(); ++i) {
      const float column = float(i % 32), row = float(i / 32);
      const bool inside = shape == 0   ? false
                          : shape <= 2 ? true
                          : shape <= 4 ? x * column + y * row < edge
                                       : random.index(2) == 0;
      uint32_t code = depth;
      if (depths == 1)
        code = 1 + uint32_t(std::min(std::max(float(depth) + 8 * x * column + 8 * y * row, 0.0f), 1022.0f));
      if (depths == 2) code = row < 16 ? depth : 1 + (depth + 300) % 1000;
      if (depths == 3) code = std::min(depth + random.index(3), 1023u);
      lines[i] = uint16_t(inside ? code : 0);
    }
    field_.coverage().finish(slot, lines);
  }

  Field field_;
};

// ---- random and extreme values

constexpr float k_extremes[] = {0.0f,
                                -0.0f,
                                1.0f,
                                -1.0f,
                                0x1p-149f,
                                -0x1p-149f,
                                0x1.fffffcp-127f,
                                0x1p-126f,
                                0x1p-60f,
                                0x1p60f,
                                0x1.fffffep127f,
                                -0x1.fffffep127f,
                                0x1.fffffep-1f,
                                0x1.000002p0f,
                                2147483648.0f,
                                std::numeric_limits<float>::infinity(),
                                -std::numeric_limits<float>::infinity(),
                                std::numeric_limits<float>::quiet_NaN(),
                                -std::numeric_limits<float>::quiet_NaN()};

class Values {
 public:
  explicit Values(uint32_t seed) : random(seed) {}

  // `value`, or with a probability of `wild` an extreme one.
  float spoilt(float value) {
    if (random.uniform() >= wild) return value;
    return random.index(4) == 0 ? std::bit_cast<float>(random.index(0xffffffffu))
                                : k_extremes[random.index(uint32_t(std::size(k_extremes)))];
  }
  Vec3 spoilt(const Vec3& v) { return {spoilt(v.x), spoilt(v.y), spoilt(v.z)}; }

  TestRandom random;
  float wild = 0.0f;
};

// ---- one object under a random transform, and questions about it

struct Launch {
  SegmentTask task;
  float from_unit[9];
  Vec3 centre;  // of the object, in world space
  float size;
  size_t entries, warps;
};

Launch random_launch(const RandomField& field, Values& values) {
  TestRandom& random = values.random;
  Launch l;
  l.entries = 1 + random.index(k_most_entries);
  l.warps = padded(l.entries) / k_warp;
  // Many launches without extreme values in the transform, some with them.
  values.wild = random.index(8) == 0 ? 0.1f : 0.0f;
  const Vec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
  const bool is_similar = random.index(2) == 0;
  l.size = random.log_uniform(1e-2f, 1e2f);
  const float squash = is_similar ? 1.0f : random.log_uniform(0.05f, 1.0f);
  l.centre = l.size * 3.0f * random.in_ball();
  const Mat3 linear(x * l.size, y * (l.size * squash), z * l.size), inverse = glm::inverse(linear);
  const Vec3 offset = -(inverse * l.centre);
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      l.task.to_unit[3 * c + r] = values.spoilt(inverse[c][r]);
      l.from_unit[3 * c + r] = values.spoilt(linear[c][r]);
    }
    l.task.to_unit[9 + c] = values.spoilt(offset[c]);
  }
  l.task.to_unit_stretch = values.spoilt(1.0f / (l.size * squash));
  l.task.to_unit_area = values.spoilt(1.0f / (l.size * l.size * squash));
  l.task.keeps_angles = is_similar && random.index(4) != 0;
  l.task.field = field.view();
  l.task.policy = {int(random.index(66)) - 1, int(random.index(66)) - 1, random.index(4) == 0,
                   random.log_uniform(0.1f, 10.0f)};
  l.task.instance = random.index(3);
  l.task.self_only = random.index(8) == 0;
  l.task.reads_depth = random.index(8) != 0;
  // Of the entries of a launch none, few or many are extreme.
  const float wild[] = {0.0f, 0.0f, 0.002f, 0.05f};
  values.wild = wild[random.index(4)];
  return l;
}

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
      const bool both_nan = gpu.clear[l] != gpu.clear[l] && cpu.clear[l] != cpu.clear[l];
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

// Calls run(launch, architectures) for each variant of a kernel.
template <class Arguments, class Run>
void for_each_variant(const std::string& name, const Run& run) {
  int variants = 0;
  for (const ptx::PtxKernel& kernel : ptx::ptx_kernels()) {
    if (kernel.name != name) continue;
    ASSERT_EQ(kernel.argument_bytes, sizeof(Arguments));
    ++variants;
    run([&](const Arguments& a) { kernel.launch(a.warps, &a); }, kernel.targets);
    if (testing::Test::HasFatalFailure()) return;
  }
  ASSERT_GT(variants, 0);
}

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

  // Rays about the object of a launch, past or towards it; those of the padding are inactive.
  RayBatch rays_about(const Launch& l, Values& values) {
    TestRandom& random = values.random;
    RayBatch rays;
    rays.resize(l.entries);
    for (size_t i = 0; i < l.entries; ++i) {
      const Vec3 o = l.centre + l.size * random.uniform(0.0f, 3.0f) * random.direction();
      const Vec3 to = l.centre + l.size * 1.1f * random.in_ball();
      const float length = random.log_uniform(0.05f, 5.0f);
      const float tmax = random.index(16) == 0 ? -1.0f : random.index(8) == 0 ? k_infinity : length;
      rays.set(i, values.spoilt(o), values.spoilt(to - o), values.spoilt(tmax));
    }
    return rays;
  }
  std::vector<uint32_t> instances_of(const Launch& l) {
    std::vector<uint32_t> instances(padded(l.entries));
    for (uint32_t& i : instances) i = random_.index(3);
    return instances;
  }

  static RayArrays arrays_of(const RayBatch& r) {
    return {r.ox.data(), r.oy.data(), r.oz.data(), r.dx.data(), r.dy.data(), r.dz.data(), r.tmax.data()};
  }

  TestRandom random_;
  std::vector<std::unique_ptr<RandomField>> fields_;
  std::vector<const SegmentKernels*> tables_;
};

TEST(PtxKernels, TheCompilerMadeNothingThatRoundsOtherwise) {
  for (const std::string& refusal : ptx::ptx_refusals()) ADD_FAILURE() << refusal;
  EXPECT_GE(ptx::ptx_kernels().size(), 4u);
}

TEST_F(PtxParity, Query) {
  for_each_variant<QueryArguments>("query", [&](const auto& launch, const std::string& targets) {
    Values values(1);
    size_t entries = 0, verdicts[3] = {}, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      const RayBatch rays = rays_about(l, values);
      const std::vector<uint32_t> instances = instances_of(l);
      Outputs<RayMasks> out(l.warps);
      launch({l.task, arrays_of(rays), instances.data(), out.masks.data(), out.missing.data(), uint32_t(l.warps)});
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
  for_each_variant<StratumArguments>("filter_strata", [&](const auto& launch, const std::string& targets) {
    Values values(2);
    size_t entries = 0, partial = 0, dark = 0, refused = 0, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      TestRandom& random = values.random;
      const RayBatch rays = rays_about(l, values);
      StratumTask task;
      task.segment = l.task;
      task.share = 1.0f / float(1 + random.index(64));
      task.least_disc = random.log_uniform(0.1f, 4.0f);
      AlignedVector<float> pdf(padded(l.entries)), radius(padded(l.entries));
      AlignedVector<int32_t> wanted(padded(l.entries));
      const float least_pdf = random.log_uniform(0.1f, 1e4f);
      for (size_t i = 0; i < l.entries; ++i) {
        pdf[i] = values.spoilt(random.index(32) == 0 ? 0.0f : least_pdf * random.log_uniform(1.0f, 100.0f));
        radius[i] = values.spoilt(random.index(2) == 0 ? 0.0f : l.size * random.log_uniform(1e-4f, 0.1f));
        wanted[i] = random.index(8) != 0;
      }
      Outputs<StratumMasks> out(l.warps);
      std::vector<float> shares(padded(l.entries), -1.0f);
      launch({task, arrays_of(rays), pdf.data(), radius.data(), wanted.data(), shares.data(), out.masks.data(),
              out.missing.data(), uint32_t(l.warps)});
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
          const StratumMasks& m = out.masks[warp];
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
  for_each_variant<ConeArguments>("light_cones", [&](const auto& launch, const std::string& targets) {
    Values values(3);
    size_t entries = 0, counts[3] = {}, not_baked = 0;
    while (entries < k_least_entries) {
      const Launch l = random_launch(any_field(), values);
      TestRandom& random = values.random;
      ConeTask task;
      task.segment = l.task;
      std::copy_n(l.from_unit, 9, task.from_unit);
      for (float& h : task.half_extent) h = random.uniform(0.1f, 0.6f);
      task.plane_fit_side = int(random.index(5));
      const float distance = random.log_uniform(1.5f, 30.0f);
      const Sphere light = {values.spoilt(l.centre + l.size * distance * random.direction()),
                            values.spoilt(l.size * distance * random.log_uniform(1e-4f, 0.5f))};
      ShadingPointBatch points;
      points.resize(l.entries);
      AlignedVector<int32_t> flags(padded(l.entries), 0);
      for (size_t i = 0; i < l.entries; ++i) {
        // In the object's shadow, or anywhere.
        Vec3 p = l.centre + l.size * random.uniform(0.0f, 3.0f) * random.direction(), n = random.direction();
        if (random.index(2) == 0) {
          const Vec3 away = glm::normalize(l.centre + l.size * random.in_ball() - light.centre);
          p = l.centre + l.size * (random.in_ball() + random.uniform(0.0f, 3.0f) * away);
          n = -away;
        }
        p = values.spoilt(p), n = values.spoilt(n);
        points.px[i] = p.x, points.py[i] = p.y, points.pz[i] = p.z;
        points.gx[i] = n.x, points.gy[i] = n.y, points.gz[i] = n.z;
        points.error[i] = values.spoilt(l.size * 1e-6f);
        points.radius[i] = values.spoilt(random.index(2) == 0 ? 0.0f : l.size * random.log_uniform(1e-4f, 0.2f));
        points.instance[i] = random.index(3);
        points.transmits[i] = random.index(8) == 0;
        flags[i] = int32_t(random.index(8));
      }
      const std::vector<uint32_t> transmits(points.transmits.begin(), points.transmits.end());
      Outputs<ConeMasks> out(l.warps);
      ConeArguments a = {
          task,
          {light.centre.x, light.centre.y, light.centre.z},
          light.radius,
          {points.px.data(), points.py.data(), points.pz.data(), points.gx.data(), points.gy.data(), points.gz.data(),
           points.error.data(), points.radius.data(), points.instance.data(), transmits.data()},
          flags.data(),
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
          // The flags that the masks make of the old ones (gpu/device_questions.cpp) must be the CPU's.
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

TEST(PtxKernels, Scatter) {
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
