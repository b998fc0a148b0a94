// The scenes whose pictures are kept as references (tests/references/*.exr), and how they are rendered.
//
// References are Monte Carlo pictures of many renders, with other seeds than any test has, made by
// tools/update_references.sh. They are as independent of what is tested as pictures by this program can be: the
// hybrid's fields have no part in them, but camera, materials and light samples do. tests/peer compares those with
// Mitsuba. Thread-safety: one thread at a time.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/render/render.h"
#include "tests/support/image_statistics.h"

namespace fieldtrace::test {

struct ReferenceScene {
  const char* name;
  const char* file;  // relative to the repository
  int spp, light_samples, lobe_samples;
  int renders;  // of a picture under test: fewer where each takes long
};

const std::vector<ReferenceScene>& reference_scenes();
const ReferenceScene& reference_scene(const std::string& name);

inline constexpr int k_reference_renders = 1024;
inline constexpr uint32_t k_first_reference_seed = 1'000'000;

// Loads the scene with meshes that are made for it, without warnings.
Scene load_reference_scene(const ReferenceScene& scene);

std::string reference_path(const ReferenceScene& scene);

struct Renders {
  std::vector<Image> images;
  Stats last;  // of the last one
};

// Renders by seeds first_seed, first_seed + 1, ...; fields, if there are any, are baked once for all.
Renders render_reference_scene(const Scene& loaded, const ReferenceScene& scene, Method method, int renders,
                               uint32_t first_seed, float tolerance = k_default_tolerance);

// What fields may add at the default tolerance, by the aims of docs/decisions/017-figures.md, row 10, which are stated
// for a picture of level 1: here for the reference's mean.
Allowance field_allowance(const SampledPicture& reference, bool under_sky);

}  // namespace fieldtrace::test
