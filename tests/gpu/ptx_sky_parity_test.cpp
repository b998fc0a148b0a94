// The PTX of sky_cells gives the sums and masks of the CPU's kernels, scalar and SIMD, bit for bit.
#include <gtest/gtest.h>

#include "core/simd/isa.h"
#include "gpu/device_arguments.h"
#include "tests/gpu/ptx_variants.h"
#include "tests/gpu/random_questions.h"
#include "tests/support/cell_tasks.h"

namespace fieldtrace::gpu {
namespace {

// What the CPU's kernel makes of the cells of blocks one after another: six sums, and a mask for each block and cell.
struct CellAnswers {
  std::vector<float> sums[6];
  std::vector<uint32_t> undecided;
};

CellAnswers see_cells(Isa isa, std::span<const CellTask> tasks, std::span<const SkyBlock> blocks, const CellPoints& p) {
  CellAnswers a;
  AlignedVector<float> sums[6];
  for (auto& sum : sums) sum.assign(size_t(p.size), 0.0f);
  AlignedVector<int32_t> listed(2 * k_warp);
  for (size_t w = 0; w < blocks.size(); ++w) {
    const size_t i = w * k_warp;
    const CellPoints points = {p.px + i, p.py + i, p.pz + i, p.gx + i,        p.gy + i,         p.gz + i,
                               p.sx + i, p.sy + i, p.sz + i, int32_t(k_warp), blocks[w].grazing};
    const auto sum = [&](int c) { return sums[c].data() + i; };
    for (uint32_t k = 0; k < blocks[w].cells; ++k) {
      const int count = cell_kernels(isa).see_cell(tasks[blocks[w].first_task + k], points,
                                                   {sum(0), sum(1), sum(2), sum(3), sum(4), sum(5)}, listed.data());
      uint32_t mask = 0;
      for (int l = 0; l < count; ++l) mask |= 1u << uint32_t(listed[size_t(l)]);
      a.undecided.push_back(mask);
    }
  }
  for (int c = 0; c < 6; ++c) a.sums[c].assign(sums[c].begin(), sums[c].end());
  return a;
}

TEST(PtxParityOfSkies, SkyCells) {
  if (ptx::ptx_kernels().empty()) GTEST_SKIP() << ptx::k_no_kernels;
  TestRandom maps_random(7);
  const test::NoisyMaps maps({8, 16, 64}, {2, 8, 16}, maps_random);
  for_each_variant<SkyArguments>("sky_cells", [&](const auto& launch, const std::string& targets) {
    Values values(6);
    TestRandom& random = values.random;
    size_t looked = 0, undecided = 0, taken = 0, reflected = 0, points_seen = 0;
    while (looked < k_least_entries) {
      // Pointers into each of them: they stay where they are.
      std::vector<std::unique_ptr<test::RandomTask>> made;
      std::vector<CellTask> tasks;
      for (uint32_t n = 1 + random.index(40); n > 0; --n) {
        made.push_back(std::make_unique<test::RandomTask>());
        test::make_task(maps.views, random, *made.back());
        if (random.index(2)) test::add_radiance(maps.radiance, random, *made.back());
        tasks.push_back(made.back()->task);
      }
      test::Points points = test::random_points(*made[0], 1 + random.index(256), random);
      values.wild = random.index(4) == 0 ? 0.05f : 0.0f;
      for (auto& array : points.values) {
        for (float& v : array) v = values.spoilt(v);
      }
      const CellPoints view = points.view();
      const uint32_t warps = uint32_t(view.size) / k_warp;
      // Warps see some of the tasks each.
      std::vector<SkyBlock> blocks;
      uint32_t masks = 0;
      for (uint32_t w = 0; w < warps; ++w) {
        const uint32_t first = random.index(uint32_t(tasks.size()));
        const uint32_t cells = 1 + random.index(uint32_t(tasks.size()) - first);
        blocks.push_back({first, cells, masks, random.index(2) ? random.uniform() : 0.0f});
        masks += cells;
      }
      CellAnswers gpu;
      for (auto& sum : gpu.sums) sum.assign(size_t(view.size), -7.0f);
      gpu.undecided.assign(masks, 0xcdcdcdcdu);
      launch({tasks.data(),
              blocks.data(),
              view,
              {gpu.sums[0].data(), gpu.sums[1].data(), gpu.sums[2].data(), gpu.sums[3].data(), gpu.sums[4].data(),
               gpu.sums[5].data()},
              gpu.undecided.data(),
              warps});
      for (const Isa isa : {Isa::scalar, resolve_isa(Isa::automatic)}) {
        // What max() makes of NaN depends on the CPU's instruction set; a GPU's does as the scalar one.
        if (values.wild > 0.0f && isa != Isa::scalar) continue;
        const CellAnswers cpu = see_cells(isa, tasks, blocks, view);
        ASSERT_EQ(gpu.undecided, cpu.undecided) << targets << " " << isa_name(isa);
        for (int c = 0; c < 6; ++c) {
          for (size_t i = 0; i < size_t(view.size); ++i) {
            const float a = gpu.sums[c][i], b = cpu.sums[c][i];
            ASSERT_TRUE((std::isnan(a) && std::isnan(b)) || std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b))
                << targets << " " << isa_name(isa) << ", sum " << c << ": " << a << " and " << b;
          }
        }
      }
      for (const uint32_t mask : gpu.undecided) undecided += size_t(std::popcount(mask));
      for (size_t i = 0; i < size_t(view.size); ++i) taken += gpu.sums[0][i] > 0.0f, reflected += gpu.sums[3][i] > 0.0f;
      points_seen += size_t(view.size);
      looked += size_t(masks) * k_warp;
    }
    EXPECT_GT(undecided, looked / 50);
    EXPECT_LT(undecided, looked / 2);
    EXPECT_GT(taken, points_seen / 4);
    EXPECT_GT(reflected, points_seen / 10);
  });
}

}  // namespace
}  // namespace fieldtrace::gpu
