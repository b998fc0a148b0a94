// The memory that the fields of one render may take together, and how much they take.
//
// Fields charge memory before they touch it: a brick's layer (field/store/layout.hd.h) with its first slice, a coverage
// tile with its sums, tables by the page. Whether a render exceeds its budget depends on what it demands, not on which
// thread comes first: charges only grow, and after the first that does not fit all are refused. What a render then does
// is the renderer's decision (hybrid/fields/field_set.h). Thread-safety: every function may be called from any thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

namespace fieldtrace {

class FieldBudget {
 public:
  // Maps of each kind (direction maps, radiance maps of glossy rays) may take 1 / k_map_share of it, besides.
  static constexpr uint64_t k_map_share = 4;
  static constexpr uint64_t k_no_limit = std::numeric_limits<uint64_t>::max();

  explicit FieldBudget(uint64_t bytes = k_no_limit) : limit_(bytes) {}

  // Charges `bytes`. False, with nothing charged, if they do not fit or if any charge was refused before.
  bool take(uint64_t bytes) {
    if (exceeded()) return false;
    const uint64_t after = used_.fetch_add(bytes, std::memory_order_relaxed) + bytes;
    if (after <= limit_) return true;
    used_.fetch_sub(bytes, std::memory_order_relaxed);
    refuse();
    return false;
  }
  void give_back(uint64_t bytes) { used_.fetch_sub(bytes, std::memory_order_relaxed); }
  // For a field that cannot grow because its address space is used up.
  void refuse_addresses() {
    out_of_addresses_.store(true, std::memory_order_relaxed);
    refuse();
  }

  uint64_t limit() const { return limit_; }
  uint64_t used() const { return used_.load(std::memory_order_relaxed); }
  bool exceeded() const { return exceeded_.load(std::memory_order_relaxed); }
  bool out_of_addresses() const { return out_of_addresses_.load(std::memory_order_relaxed); }

 private:
  void refuse() { exceeded_.store(true, std::memory_order_relaxed); }

  const uint64_t limit_;
  std::atomic<uint64_t> used_ = 0;
  std::atomic<bool> exceeded_ = false, out_of_addresses_ = false;
};

}  // namespace fieldtrace
