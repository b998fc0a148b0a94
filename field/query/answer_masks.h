// Answers about blocks of k_batch_padding (32) entries as masks, bit l of which is entry l's: what a device sends back.
//
// Where any entry of a block met something that is not resident on the device, nothing is answered: all bits of
// `not_baked` are set, and the other masks mean nothing. Thread-safety: values.
#pragma once

#include <cstdint>

namespace fieldtrace {

struct ConeMasks {
  uint32_t clear, blocked, by_strata, not_baked;
  uint32_t lookups;  // of the block
};

// Of strata and of lobes.
struct ShareMasks {
  uint32_t refused, not_baked;
  uint32_t lookups;
};

struct RayMasks {
  uint32_t crosses, blocked, undecided, not_baked;
  uint32_t lookups;
};

}  // namespace fieldtrace
