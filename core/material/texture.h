// Textures: constant, checkerboard and bitmap, looked up at surface coordinates.
//
// Conventions follow Mitsuba 3 (plugins `checkerboard` and `bitmap`): a bitmap's row 0 (the top of the image) lies at v
// = 0, texel (i, j) has its centre at ((i + 0.5) / width, (j + 0.5) / height), and a checkerboard shows color0 where
// frac(u) and frac(v) lie in the same half of [0, 1).
// Thread-safety: pure functions of a const scene.
#pragma once

#include "core/scene/scene.h"

namespace fieldtrace {

// The linear RGB value of Scene::textures[index] at (u, v), any finite coordinates (others are taken as 0).
// Unchecked: the caller guarantees a valid index and, for bitmaps, at least one pixel.
Rgb evaluate_texture(const Scene& scene, uint32_t index, const Vec2& uv);

// The same as one number, as Mitsuba 3.9 takes it: the luminance of bitmaps, the mean of other colours; checkerboards
// have their colours the other way round.
float evaluate_scalar_texture(const Scene& scene, uint32_t index, const Vec2& uv);

}  // namespace fieldtrace
