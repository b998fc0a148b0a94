// The thesis' displacement field of one object: for 4,226 entry points times M x M directions the distance to the
// surface and the normal there, baked whole with Embree.
//
// Source: A. Andreadis, 2008. Memory layout: field/thesis/thesis_view.h. Thread-safety: const after baking.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"
#include "core/trace/accel.h"
#include "field/bake/bake.h"
#include "field/thesis/thesis_view.h"

namespace fieldtrace {

// Samples of a field: 4,226 M^2.
size_t thesis_samples(int m);

// What is kept of a sample. Shadows need no normals.
enum class ThesisLayers { distance, distance_normal };

// Whether the parameters of an identity are those of a thesis field: M is 32, 64 or 128, the others 0.
bool valid_thesis_parameters(const FieldParameters& parameters);

class ThesisField {
 public:
  // m: a power of two, 2 ... 128. All samples are misses.
  ThesisField(const Sphere& ball, int m, ThesisLayers layers = ThesisLayers::distance_normal);

  ThesisFieldView view() const;
  const Sphere& ball() const { return ball_; }  // object space
  int m() const { return m_; }
  size_t samples() const { return thesis_samples(m_); }
  size_t bytes_distance() const { return samples(); }
  size_t bytes_normal() const { return has_normals() ? 3 * samples() : 0; }
  size_t bytes() const { return bytes_distance() + bytes_normal(); }
  bool has_normals() const { return layers_ == ThesisLayers::distance_normal; }
  // For baking: M^2 samples of one position.
  uint8_t* distances_of(uint32_t position) { return &distance_[size_t(position) * size_t(m_) * size_t(m_)]; }
  uint8_t* normals_of(uint32_t position) { return &normal_[3 * size_t(position) * size_t(m_) * size_t(m_)]; }

 private:
  Sphere ball_;
  int m_;
  ThesisLayers layers_;
  std::vector<uint8_t> distance_, normal_;
};

struct ThesisBakeCallbacks {
  std::function<void(float share)> progress;  // from one thread at a time
  const std::atomic<bool>* stop = nullptr;
  BakeCounters* counters = nullptr;  // rays and seconds, summed over all threads, are added
};

// A ball about the centre of the object's bounding box, out to its farthest vertex, enlarged for rounding.
Sphere thesis_ball(const TriangleMesh& mesh);

// Traces every sample of a shape of `scene`, a mesh, which `accel` was built for. Empty if `stop` ended it. The normal
// is the shading normal of the hit, turned against the ray.
std::optional<ThesisField> bake_thesis_field(const Accel& accel, const Scene& scene, uint32_t shape, int m,
                                             const ThesisBakeCallbacks& callbacks = {},
                                             ThesisLayers layers = ThesisLayers::distance_normal);

// Tolerance of shadow look-ups, in unit space. The nearest sample of a field differs from the ray: at the entry by up
// to the circumradius of the widest triangle of entry points, .0427, and at the hit, about 1 from there, by up to half
// the diagonal of a direction cell of 2 / M. On surfaces that a light sees at a slope of 1/2 (27 degrees) or steeper,
// depths differ by up to twice that; the stored distance is off by half a step of 2 / 254, too.
float thesis_slack(int m);

// One instance of the scene with its shape's field.
ThesisInstanceView thesis_instance_view(const ThesisField& field, const Instance& instance, uint32_t index);

}  // namespace fieldtrace
