// Radiance of an object's surface, as seen along directions or over a plane, with prefiltered levels.
//
// Memory layout: radiance_view.h. Thread-safety: different pyramids may be filled at once; const otherwise.
#pragma once

#include <bit>
#include <span>

#include "core/math/math.h"
#include "core/platform/aligned_vector.h"
#include "field/maps/radiance_view.h"

namespace fieldtrace {

// Levels of half, a quarter, ... of `texels` along a side, a power of two, down to one.
inline int pyramid_levels(int texels) { return std::bit_width(unsigned(texels)) - 1; }

class RadiancePyramids {
 public:
  // `texels`: a power of two in [2, 256]. All black. Throws std::bad_alloc.
  RadiancePyramids(int texels, int count);

  static uint64_t bytes_of(int texels, int count);
  uint64_t bytes() const { return words_.size() * sizeof(uint32_t); }
  RadianceView view() const;

  // The largest component that what is filled in next may have.
  void set_most(float radiance);
  // Makes pyramid `i` of texels^2 radiances, row by row; `is_known` is 0 for texels without any.
  void fill(int i, std::span<const Rgb> radiance, std::span<const uint8_t> is_known);

 private:
  int texels_;
  float scale_ = 0.0f;
  AlignedVector<uint32_t> words_;
};

}  // namespace fieldtrace
