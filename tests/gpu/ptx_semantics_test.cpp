// The functions that stand for PTX instructions give what the PTX ISA says, at the edges where C++ would not.
#include "tests/gpu/ptx_semantics.h"
#include "tests/gpu/ptx_counts.h"

#include <gtest/gtest.h>

#include "tests/support/random_lines.h"

namespace fieldtrace::ptx {
namespace {

constexpr float k_inf = std::numeric_limits<float>::infinity();
const float k_nan = float_of(0xffc12345u);
uint32_t bits(float a) { return std::bit_cast<uint32_t>(a); }

TEST(PtxSemantics, ArithmeticYieldsTheCanonicalNan) {
  EXPECT_EQ(bits(add(k_inf, -k_inf)), 0x7fffffffu);
  EXPECT_EQ(bits(mul(k_nan, 1.0f)), 0x7fffffffu);
  EXPECT_EQ(bits(div(0.0f, 0.0f)), 0x7fffffffu);
  EXPECT_EQ(bits(root(-1.0f)), 0x7fffffffu);
  EXPECT_EQ(bits(root(-0.0f)), 0x80000000u);
  EXPECT_EQ(bits(mul(float_of(1u), 0.5f)), 0u);  // denormals are kept, and round to even
  EXPECT_EQ(bits(mul(float_of(3u), 0.5f)), 2u);
}

TEST(PtxSemantics, MinimumAndMaximumPassOverNan) {
  EXPECT_EQ(minimum(k_nan, 2.0f), 2.0f);
  EXPECT_EQ(maximum(2.0f, k_nan), 2.0f);
  EXPECT_EQ(bits(maximum(k_nan, k_nan)), 0x7fffffffu);
  EXPECT_EQ(bits(maximum(-0.0f, 0.0f)), 0u);
  EXPECT_EQ(bits(minimum(0.0f, -0.0f)), 0x80000000u);
}

TEST(PtxSemantics, ConversionsSaturate) {
  EXPECT_EQ((to_whole<int32_t, Rounding::zero>(3e9f)), 2147483647);
  EXPECT_EQ((to_whole<int32_t, Rounding::zero>(-k_inf)), -2147483647 - 1);
  EXPECT_EQ((to_whole<int32_t, Rounding::zero>(k_nan)), 0);
  EXPECT_EQ((to_whole<uint32_t, Rounding::zero>(-1.0f)), 0u);
  EXPECT_EQ((to_whole<uint32_t, Rounding::zero>(5e9f)), 0xffffffffu);
  EXPECT_EQ((to_whole<int64_t, Rounding::zero>(k_nan)), std::numeric_limits<int64_t>::min());
  EXPECT_EQ((to_whole<int32_t, Rounding::nearest>(2.5f)), 2);
  EXPECT_EQ((to_whole<int32_t, Rounding::down>(-0.5f)), -1);
  EXPECT_EQ((to_whole<int32_t, Rounding::up>(-0.5f)), 0);
  EXPECT_EQ(bits(round_to_whole<Rounding::down>(-0.0f)), 0x80000000u);
}

TEST(PtxSemantics, RegistersAreCutAndExtended) {
  EXPECT_EQ(get<int8_t>(uint16_t(0x1280)), -128);
  EXPECT_EQ(get<float>(0x3f800000u), 1.0f);
  EXPECT_EQ(put<uint32_t>(int8_t(-2)), 0xfffffffeu);
  EXPECT_EQ(put<uint32_t>(uint8_t(0xfe)), 0xfeu);
}

TEST(PtxSemantics, ShiftsOfAllBitsAreDefined) {
  EXPECT_EQ(shift_left<uint32_t>(1u, 32), 0u);
  EXPECT_EQ(shift_right<uint32_t>(0x80000000u, 40), 0u);
  EXPECT_EQ(shift_right<int32_t>(-5, 33), -1);
  EXPECT_EQ(shift_right<int32_t>(-5, 1), -3);
  EXPECT_EQ(funnel(true, false, 0x89abcdefu, 0x01234567u, 8), 0x23456789u);
  EXPECT_EQ(funnel(false, true, 0x89abcdefu, 0x01234567u, 36), 0x789abcdeu);
  EXPECT_EQ(funnel(true, false, 0x89abcdefu, 0x01234567u, 99), 0x89abcdefu);
}

TEST(PtxSemantics, BitsOfAWord) {
  EXPECT_EQ(extract_bits<uint32_t>(0xabcd1234u, 8, 8), 0x12u);
  EXPECT_EQ(extract_bits<int32_t>(int32_t(0xabcd1234u), 24, 8), int32_t(0xffffffabu));
  EXPECT_EQ(extract_bits<int32_t>(int32_t(0x80000000u), 28, 12), -8);
  EXPECT_EQ(extract_bits<uint32_t>(0xffffffffu, 4, 0), 0u);
  EXPECT_EQ(insert_bits<uint32_t>(0x5u, 0xffffffffu, 4, 8), 0xfffff05fu);
  EXPECT_EQ(permute(0x03020100u, 0x87060504u, 0x7410u), 0x87040100u);
  EXPECT_EQ(permute(0x03020180u, 0x87060504u, 0x18f8u), 0x01ffffffu);
  EXPECT_EQ(leading_zeros(0u), 32u);
  EXPECT_EQ(count_bits(0xf0f0u), 8u);
  EXPECT_EQ(reversed(1u), 0x80000000u);
  EXPECT_EQ(high_product<int32_t>(-1, 1), -1);
  EXPECT_EQ(high_product<uint32_t>(0xffffffffu, 2u), 1u);
  EXPECT_EQ(quotient<int32_t>(std::numeric_limits<int32_t>::min(), -1), std::numeric_limits<int32_t>::min());
  EXPECT_EQ(remainder<int32_t>(-7, 4), -3);
}

TEST(PtxSemantics, AFaultIsThrown) {
  alignas(8) const uint32_t words[2] = {1, 2};
  const auto at = uint64_t(std::bit_cast<uintptr_t>(&words[0]));
  EXPECT_EQ(load<uint32_t>(at + 4, "x"), 2u);
  EXPECT_THROW(load<uint32_t>(at + 2, "x"), PtxFault);
  EXPECT_THROW(require_aligned(at + 4, 8, "x"), PtxFault);
}

struct TestLane : Lane {};

// A lane that gives `operand` of a shuffle and stores what it gets.
template <WarpOp k_op>
void shuffle(TestLane& s) {
  if (s.at == 0) {
    s.value = 100 + s.thread, s.op = k_op, s.operand = s.block, s.clamp = k_op == WarpOp::shuffle_up ? 0 : 31;
    s.mask = 0xffffffffu, s.at = 1;
    return;
  }
  std::bit_cast<uint32_t*>(s.arguments)[s.block * 32 + s.thread] = s.result + (s.in_range ? 0 : 1000);
  s.at = Lane::k_exited;
}

TEST(PtxSemantics, LanesExchange) {
  std::vector<uint32_t> got(32 * 32);
  run_blocks(&shuffle<WarpOp::shuffle_xor>, "xor", 32, got.data());
  for (uint32_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i], 100 + (i % 32 ^ i / 32));
  run_blocks(&shuffle<WarpOp::shuffle_down>, "down", 32, got.data());
  for (uint32_t i = 0; i < got.size(); ++i) {
    const uint32_t from = i % 32 + i / 32;
    EXPECT_EQ(got[i], from < 32 ? 100 + from : 1100 + i % 32);
  }
  run_blocks(&shuffle<WarpOp::shuffle_up>, "up", 32, got.data());
  for (uint32_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i], i % 32 >= i / 32 ? 100 + i % 32 - i / 32 : 1100 + i % 32);
  }
  run_blocks(&shuffle<WarpOp::shuffle_index>, "index", 32, got.data());
  for (uint32_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i], 100 + i / 32);
  run_blocks(&shuffle<WarpOp::ballot>, "ballot", 1, got.data());
  for (uint32_t i = 0; i < 32; ++i) EXPECT_EQ(got[i], 0xffffffffu);
}

void leave_early(TestLane& s) {
  s.at = s.thread == 3 ? Lane::k_exited : 1;
  s.mask = 0xffffffffu;
}
void part_of_a_warp(TestLane& s) {
  s.at = 1;
  s.mask = 0xffffu;
}

TEST(PtxSemantics, AWarpMustStayTogether) {
  EXPECT_THROW(run_blocks(&leave_early, "early", 1, nullptr), PtxFault);
  EXPECT_THROW(run_blocks(&part_of_a_warp, "part", 1, nullptr), PtxFault);
}

struct LaneOfTwoBlocks : CountedLane {
  uint32_t runs[2] = {};
};

TEST(PtxCounts, OfAWarpThatParts) {
  LaneOfTwoBlocks lanes[k_lanes];
  for (uint32_t l = 0; l < k_lanes; ++l) {
    lanes[l].runs[0] = 1;
    lanes[l].runs[1] = l % 4;
    // A row of words: 4 sectors. Then one word all lanes read, in a sector of the row, up to three times.
    lanes[l].touch(7, 1024 + 4 * l);
    for (uint32_t n = 0; n < l % 4; ++n) lanes[l].touch(9, 1056);
  }
  lanes[1].touch(9, 8192);  // its second run
  constexpr uint32_t k_sizes[] = {10, 5};
  const PtxCounts c = count_warp(lanes, k_sizes);
  EXPECT_EQ(c.warps, 1u);
  EXPECT_EQ(c.instructions, 10u + 3 * 5u);
  EXPECT_EQ(c.requests, 1u + 3);
  EXPECT_EQ(c.request_sectors, 4u + 1 + 2 + 1);
  EXPECT_EQ(c.warp_sectors, 4u + 1);
}

}  // namespace
}  // namespace fieldtrace::ptx
