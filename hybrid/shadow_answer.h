// How a batch of shadow rays is answered: the one place where Monte Carlo and the hybrid method differ.
//
// Thread-safety: answerers are const once made and serve any number of threads, each with its own batch and Stats.
// Determinism: the answer for one ray must not depend on the other rays of its batch.
#pragma once

#include <cstdint>
#include <memory>

#include "core/accel.h"
#include "core/receivers.h"
#include "hybrid/stats.h"

namespace fieldtrace {

// The rays of one light for a group of receivers. Slot r * light_samples + k of `batch` belongs to receiver r.
struct ShadowQuery {
  uint32_t light = 0;    // index into Scene::emitters
  Bounds3 light_bounds;  // world space; empty for lights at infinity (directional, constant)
  const ReceiverBatch& receivers;
  int light_samples = 1;
  ShadowBatch& batch;
};

class ShadowAnswerer {
 public:
  virtual ~ShadowAnswerer() = default;

  // Sets batch.blocked and batch.exact of every active slot (rays.tmax >= 0); both are 0 on entry, and stay 0 for
  // inactive slots. Adds what it did to `stats` (rays_exact, rays_crossing, look-ups, checks; not rays_shadow); time
  // spent baking goes to stats.time_bake and is left out of time.secondary by the caller.
  virtual void answer(const ShadowQuery& query, Stats& stats) const = 0;
};

// Every active ray is traced. `accel` must outlive the answerer.
class ExactAnswerer final : public ShadowAnswerer {
 public:
  explicit ExactAnswerer(const Accel& accel) : accel_(accel) {}
  void answer(const ShadowQuery& query, Stats& stats) const override;

 private:
  const Accel& accel_;
};

}  // namespace fieldtrace
