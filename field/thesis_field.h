// The thesis' displacement field of one object: for 4,226 entry points times M x M directions the distance to the
// surface and the normal there, baked whole with Embree.
//
// Source: A. Andreadis, 2008. Memory layout: tools/thesis/field_view.h. Thread-safety: const
// after baking.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "core/accel.h"
#include "core/math.h"
#include "core/scene.h"
#include "tools/thesis/field_view.h"

namespace fieldtrace {

class ThesisField {
 public:
  // m: a power of two, 2 ... 128. All samples are misses.
  ThesisField(const Sphere& ball, int m);

  ThesisFieldView view() const;
  const Sphere& ball() const { return ball_; }  // object space
  int m() const { return m_; }
  size_t samples() const;
  size_t bytes_distance() const { return samples(); }
  size_t bytes_normal() const { return 3 * samples(); }
  // For baking: M^2 samples of one position.
  uint8_t* distances_of(uint32_t position) { return &distance_[size_t(position) * size_t(m_) * size_t(m_)]; }
  uint8_t* normals_of(uint32_t position) { return &normal_[3 * size_t(position) * size_t(m_) * size_t(m_)]; }

 private:
  Sphere ball_;
  int m_;
  std::vector<uint8_t> distance_, normal_;
};

struct ThesisBakeCallbacks {
  std::function<void(float share)> progress;  // from one thread at a time
  const std::atomic<bool>* stop = nullptr;
};

// The centre of the object's bounding box and the distance of its farthest vertex, enlarged for rounding.
Sphere thesis_ball(const TriangleMesh& mesh);

// Traces every sample of a shape of `scene`, which `accel` was built for. Empty if `stop` ended it. The normal is the
// shading normal of the hit, turned against the ray.
std::optional<ThesisField> bake_thesis_field(const Accel& accel, const Scene& scene, uint32_t shape, int m,
                                             const ThesisBakeCallbacks& callbacks = {});

// The nearest of a field's samples lies up to this far from a ray, in unit space: where the ray enters by the radius of
// the widest circle around a triangle of entry points, .0427, and at the hit, about 1 from there, by half the diagonal
// of a direction cell of 2 / M; the stored distance is off by half a step of 2 / 254. Surfaces that a light sees at 45
// degrees or steeper are off by that much in depth, too, which is what a shadow look-up forgives.
float thesis_slack(int m);

// One instance of the scene with its shape's field.
ThesisInstanceView thesis_instance_view(const ThesisField& field, const Instance& instance, uint32_t index);

}  // namespace fieldtrace
