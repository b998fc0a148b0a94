// What camera rays tell of a scene that maps may light, before any is made. Thread-safety: pure functions, parallel
// within.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/camera/camera.h"
#include "core/scene/scene.h"
#include "core/trace/accel.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

struct SkySurvey {
  std::vector<Vec3> seen;  // shortly before the surfaces that camera rays meet, world space
  // Of the camera rays, the share that meets a surface, and one that is diffuse and opaque: these ask maps. Above 0 if
  // none does, where there may be some between them.
  double met = 1.0, diffuse = 1.0;
  // Of rays from there, as many as the cosine has: what meets nothing, and what meshes hide that are no parallelograms
  // or boxes. Of an enclosed scene, without what those hide as well.
  double open = 1.0, hidden_by_maps = 0.0;
  std::vector<double> met_next;  // by instance, the share of these that meet it; empty: as open

  // Whether so little of the sky comes in that what maps err would show beside it, or what they let through between
  // objects that adjoin each other. Without a sky: a closed room, where what is bright leaks past what stands before
  // it.
  bool is_enclosed() const;
  // Of what they meet, the share of the instances with `these[i]`; 1 if they meet nothing.
  double share_of_met_next(std::span<const uint8_t> these) const;
};

// By a grid of camera rays over a part of the film.
SkySurvey survey_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                     const CameraSampler& camera, const Rect& window);

}  // namespace fieldtrace
