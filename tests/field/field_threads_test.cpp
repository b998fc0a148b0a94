// Look-ups while other threads write: a reader sees a cell either unknown or complete, never half written.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "field/query/query.hd.h"
#include "field/store/encode.h"
#include "field/store/field.h"

namespace fieldtrace {
namespace {

// A cell's line, whose look-up lands in exactly that cell.
struct CellLine {
  scalar::Vec3Lanes<float> direction, point;
};

CellLine line_of(const FieldView& view, const SliceAddress& slice, int cell) {
  const auto frame = scalar::frame_from_square(scalar::centre_of<float>(slice.u, view.directions),
                                               scalar::centre_of<float>(slice.v, view.directions));
  const float a = scalar::centre_of<float>(slice.a0 + cell / 8, view.plane);
  const float b = scalar::centre_of<float>(slice.b0 + cell % 8, view.plane);
  return {frame.c, frame.s * a + frame.t * b};
}

// Cells are published one by one to a reader that waits for each of them.
TEST(FieldThreads, ReaderSeesWholeCells) {
  constexpr uint32_t k_slices = 512;
  Field field(Sphere{Vec3(0.0f), 1.0f}, {.directions = 32, .plane = 64});
  const FieldView view = field.view();
  const QueryPolicy policy{.visibility_max_class = 63, .depth_max_class = 63};
  const uint32_t word = encode_depth(0.75f) | encode_normal(Vec3(0.0f, 0.0f, 1.0f));
  const float depth = scalar::decode_depth<float>(int32_t(word));
  const uint32_t certificate = encode_certificate(scalar::k_kind_plane_fit, 3, 100);

  std::atomic<uint32_t> reading = 0;
  std::thread writer([&] {
    for (uint32_t slice = 0; slice < k_slices; ++slice) {
      const auto first = field.claim(FieldLayer::depth, slice);
      if (!first) return;
      for (uint32_t cell = 0; cell < scalar::k_slice_cells; ++cell) {
        // Wait until the reader polls this very cell.
        while (reading.load(std::memory_order_relaxed) < slice * scalar::k_slice_cells + cell) {
        }
        field.store_plane_fit(*first + cell, word, certificate);
      }
      field.finish(FieldLayer::depth, slice);
    }
  });
  uint64_t torn = 0;
  for (uint32_t i = 0; i < k_slices * scalar::k_slice_cells; ++i) {
    const CellLine line = line_of(view, field.slice_address(i / scalar::k_slice_cells), int(i % scalar::k_slice_cells));
    reading.store(i, std::memory_order_relaxed);
    for (;;) {
      const auto at = scalar::address_of_line(line.direction, line.point, view.directions, view.plane);
      const auto seen = scalar::look_up_plane_fit<float>(view, policy, at, line.point);
      if (!seen.known) continue;
      const auto normal = scalar::decode_normal<float>(int32_t(word));
      const auto centre = line.point + line.direction * depth;
      torn += seen.offset != scalar::dot(normal, centre);
      break;
    }
  }
  writer.join();
  EXPECT_EQ(torn, 0u);
}

}  // namespace
}  // namespace fieldtrace
