#include "field/bake/slice_demand.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <new>

namespace fieldtrace {

SliceDemand::SliceDemand(const Field& field) : slices_(field.slice_count()) {
  const uint32_t most = std::numeric_limits<uint16_t>::max();
  const uint32_t lines = uint32_t(field.parameters().lines);
  const uint32_t rays[k_field_layers] = {lines, lines + 2, 1};  // of a cell
  for (size_t layer = 0; layer < k_field_layers; ++layer)
    due_[layer] = std::min(most, uint32_t(scalar::k_slice_cells) * rays[layer] / k_bake_rays_of_ray);
  asked_.reset(static_cast<uint16_t*>(std::calloc(k_field_layers * size_t(slices_), sizeof(uint16_t))));
  if (!asked_) throw std::bad_alloc();
}

void SliceDemand::count(FieldLayer layer, std::vector<uint32_t>& slices) {
  std::sort(slices.begin(), slices.end());
  uint16_t* const asked = asked_.get() + size_t(layer) * slices_;
  const uint32_t due = waits_.load(std::memory_order_relaxed) ? due_[size_t(layer)] : 0;
  size_t kept = 0;
  for (size_t i = 0, next = 0; i < slices.size(); i = next) {
    const uint32_t slice = slices[i];
    for (next = i; next < slices.size() && slices[next] == slice;) ++next;
    std::atomic_ref<uint16_t> count(asked[slice]);
    // Threads that add at once may lose what one of them adds, and no more.
    const uint32_t now = std::min(uint32_t(count.load(std::memory_order_relaxed)) + uint32_t(next - i), due);
    count.store(uint16_t(now), std::memory_order_relaxed);
    if (now == due) slices[kept++] = slice;
  }
  slices.resize(kept);
}

}  // namespace fieldtrace
