// Fields with arbitrary but valid contents, and comparisons, for the tests of field files.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <random>
#include <string>

#include "field/file/field_identity.h"
#include "field/store/encode.h"
#include "field/store/field.h"
#include "field/store/risk_classes.h"

namespace fieldtrace::test {

// A new folder, removed with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::temp_directory_path() / (std::string("fieldtrace_") + info->test_suite_name() + "_" +
                                                      info->name() + "_" + std::to_string(getpid()));
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::string operator/(const std::string& name) const { return (path_ / name).string(); }
  std::string path() const { return path_.string(); }

 private:
  std::filesystem::path path_;
};

inline constexpr uint32_t k_test_primitives = 1000;

inline Sphere test_ball() { return {Vec3(0.1f, -2.0f, 1.0f / 3.0f), 1.7f}; }

inline FieldIdentity test_identity(const FieldParameters& parameters) {
  FieldIdentity identity;
  identity.geometry = {0x0123456789abcdefu, 42};
  identity.primitive_count = k_test_primitives;
  identity.parameters = parameters;
  return identity;
}

// Bakes one slice. Cells are a pure function of layer and slice, as those of a real bake are; one slice in three is
// constant: a certified miss.
inline void fill_slice(Field& field, FieldLayer layer, uint32_t slice) {
  const auto first = field.claim(layer, slice);
  if (!first) return;
  std::mt19937 random(slice * k_field_layers + uint32_t(layer));
  const bool miss = slice % 3 == 0;
  for (uint32_t i = 0; i < uint32_t(scalar::k_slice_cells); ++i) {
    const int risk = miss ? 0 : int(random() % (k_worst_class + 1));
    if (layer == FieldLayer::visibility) {
      field.store_visibility(*first + i, encode_visibility(!miss && random() % 2 == 0, risk));
    } else if (layer == FieldLayer::primitive) {
      field.store_primitive(*first + i, miss ? k_none : uint32_t(random() % k_test_primitives));
    } else if (miss || random() % 4 == 0) {
      field.store_plane_fit(*first + i, 0, encode_certificate(scalar::k_kind_miss, risk, 255));
    } else {
      field.store_plane_fit(*first + i, uint32_t(random()),
                            encode_certificate(scalar::k_kind_plane_fit, risk, uint32_t(random() % 256)));
    }
  }
  field.finish(layer, slice);
}

inline void fill_random_slices(Field& field, uint32_t seed, int count) {
  std::mt19937 random(seed);
  // Clustered, so that bricks get several slices.
  for (int i = 0; i < count; ++i) {
    const uint32_t plane_bricks = uint32_t(field.view().plane_bricks);
    const uint32_t slice = uint32_t(random() % 64) * plane_bricks + uint32_t(random() % 8);
    fill_slice(field, FieldLayer(random() % k_field_layers),
               random() % 8 == 0 ? uint32_t(random() % field.slice_count()) : slice);
  }
}

// Every slice of one brick, all certified misses.
inline void fill_miss_brick(Field& field, uint32_t direction_brick, uint32_t plane_brick) {
  for (uint32_t d = 0; d < 16; ++d) {
    const uint32_t slice = (direction_brick * 16 + d) * uint32_t(field.view().plane_bricks) + plane_brick;
    if (const auto first = field.claim(FieldLayer::visibility, slice)) {
      for (uint32_t i = 0; i < 32; ++i) field.store_visibility(*first + i, encode_visibility(false, 0));
      field.finish(FieldLayer::visibility, slice);
    }
  }
}

// The number of slices in which two fields differ: in being baked, or in any bit of any cell.
inline size_t differing_slices(const Field& a, const Field& b) {
  size_t differing = 0;
  const uint32_t plane_bricks = uint32_t(a.view().plane_bricks);
  for (uint32_t slice = 0; slice < a.slice_count(); ++slice) {
    const uint32_t direction = slice / plane_bricks;
    for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth, FieldLayer::primitive}) {
      const bool in_a = a.finished(layer, slice), in_b = b.finished(layer, slice);
      bool same = in_a == in_b;
      for (uint32_t i = 0; same && in_a && i < 32; ++i) {
        const size_t cell = (direction % 16) * 32 + i;
        const size_t at = size_t(a.brick_at(direction / 16, slice % plane_bricks)) * 512 + cell;
        const size_t bt = size_t(b.brick_at(direction / 16, slice % plane_bricks)) * 512 + cell;
        const FieldView va = a.view(), vb = b.view();
        if (layer == FieldLayer::visibility) same = va.visibility[at] == vb.visibility[bt];
        if (layer == FieldLayer::depth) same = va.depth[at] == vb.depth[bt] && va.certificate[at] == vb.certificate[bt];
        if (layer == FieldLayer::primitive) same = va.primitive[at] == vb.primitive[bt];
      }
      differing += !same;
    }
  }
  return differing;
}

}  // namespace fieldtrace::test
