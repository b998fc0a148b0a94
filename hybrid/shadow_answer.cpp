#include "hybrid/shadow_answer.h"

#include <vector>

namespace fieldtrace {

void ExactAnswerer::answer(const ShadowQuery& query, Stats& stats) const {
  ShadowBatch& batch = query.batch;
  // Kept per thread: batches come by the thousand and are alike in size.
  thread_local std::vector<uint32_t> active;
  active.resize(batch.rays.size);
  size_t count = 0;
  // Written without a branch; a slot that is not active is overwritten by the next one.
  for (size_t i = 0; i < batch.rays.size; ++i) {
    active[count] = uint32_t(i);
    const bool is_active = batch.rays.tmax[i] >= 0.0f;
    batch.exact[i] = is_active;
    count += is_active;
  }
  accel_.occluded(batch.rays, {active.data(), count}, batch.blocked.data());
  stats.rays_exact += count;
  stats.rays_crossing += count;
}

}  // namespace fieldtrace
