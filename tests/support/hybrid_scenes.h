// Small named scenes that are hard for fields, for the tests of the whole hybrid method: overlapping and crowded
// instances, lights and shading points inside bounding balls, open surfaces, every kind of light, odd transforms.
#pragma once

#include <string>
#include <vector>

#include "core/scene/scene.h"

namespace fieldtrace::test {

struct HybridScene {
  std::string name;
  Scene scene;
  // Every mesh with a field is closed and thick: the target for wrong answers is stated for such meshes.
  bool solid = true;
  // Everything that can block a shadow ray has a field, and no group has more candidates than are tested.
  bool fields_only = true;
};

// All scenes. Pictures are `size` pixels wide and high, with one object of radius 1, or several, about the origin over
// a floor.
std::vector<HybridScene> hybrid_scenes(int size);

// The scene of that name.
HybridScene hybrid_scene(const std::string& name, int size);

}  // namespace fieldtrace::test
