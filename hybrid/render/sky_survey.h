// What camera rays tell of a scene that maps may light, before any is made. Thread-safety: pure functions, parallel
// within.
#pragma once

#include <span>

#include "core/camera/camera.h"
#include "core/scene/scene.h"
#include "core/trace/accel.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

struct SkySurvey {
  double diffuse = 1.0;  // of the surfaces that camera rays meet, the share that is diffuse and opaque: these ask maps
  // Of rays from there, as many as the cosine has: what meets nothing, and what meshes hide that are no parallelograms
  // or boxes. Of an enclosed scene, without what those hide as well.
  double open = 1.0, hidden_by_maps = 0.0;
  // Parallelograms, or faces of boxes, reach through each other or go on behind each other's edges.
  bool planes_cross = false;

  // Whether so little of the sky comes in that what maps err would show beside it, or what they let through between
  // objects that adjoin each other. Without a sky: a closed room, where what is bright leaks past what stands before
  // it.
  bool is_enclosed() const;
  // The same of light that surfaces send on: texels of walls that reach through others know the light on both sides.
  bool is_dim() const;
};

// By a grid of camera rays over the whole film.
SkySurvey survey_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                     const CameraSampler& camera);

}  // namespace fieldtrace
