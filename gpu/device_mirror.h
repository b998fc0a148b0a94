// A field's copy in device memory: the slices and tiles that the device's questions have met and the CPU has finished;
// or radiance maps', which are tiles alone.
//
// Questions name what they met and did not find (`missing`); it is copied as soon as it is finished, in stream order
// before the next wave of questions; waves of other streams follow (Runtime::follow). The copy numbers pages, bricks
// and tiles by itself; a slice that is not there reads as not baked, as in the field (field/store/layout.hd.h).
// Thread-safety: one thread at a time; the field may grow meanwhile, since finished cells do not change.
#pragma once

#include <vector>

#include "field/store/field.h"
#include "gpu/device_arguments.h"
#include "gpu/device_memory.h"

namespace fieldtrace::gpu {

// Words for places all over the device's memory, which a kernel spreads.
struct Packet {
  std::vector<uint32_t> words;
  std::vector<ScatterRun> runs;
  // Of pools that were outgrown: streams may still use them.
  std::vector<DeviceBuffer> outgrown;

  void add(DeviceAddress to, const void* from, uint32_t count);
};

// What a mirror copies; must outlive it.
struct MirrorSource {
  MirrorSource() = default;
  MirrorSource(const Field& of) : field(&of), tiles(&of.coverage()), view(of.view()) {}
  // Radiance maps, seen by `maps`.
  MirrorSource(const CoverageTiles& of, const FieldView& maps) : tiles(&of), view(maps) {}

  const Field* field = nullptr;          // null: there are tiles alone
  const CoverageTiles* tiles = nullptr;  // another one of each source; null: nothing is copied
  FieldView view;                        // on the host
};

class FieldMirror {
 public:
  FieldMirror(const MirrorSource& source, DeviceMemory& memory);

  // `words`: of `missing`, k_nothing among them. Returns whether the next stage() finds any of them finished.
  bool want(std::span<const uint32_t> words);
  // Makes room for what is wanted and finished, by work of `stream`, and adds it to `packet`, which must be spread
  // there before the next call. Throws OutOfDeviceMemory, or DeviceError; the mirror is then of no use, but streams may
  // use it.
  void stage(Packet& packet, Stream stream);
  // With device addresses; complete when the packet has been spread.
  FieldView view() const;

 private:
  // A pool of device memory that grows by doubling.
  struct Pool {
    size_t item_bytes = sizeof(uint32_t);
    size_t capacity = 0;       // items
    DeviceBuffer buffer = {};  // a word larger: look-ups of bytes read whole words
  };

  // How pools grow.
  struct Growth {
    std::vector<DeviceBuffer>& outgrown;
    Stream stream;
  };

  void make_pools(const Growth& growth);
  bool take(uint32_t word);
  void grow(Pool& pool, size_t items, const Growth& growth);
  uint32_t brick_of_slice(uint32_t slice);
  void add_slice(uint32_t word, Packet& packet);
  void add_tile(uint32_t slot, Packet& packet);

  const MirrorSource source_;
  DeviceMemory& memory_;
  std::vector<uint32_t> wanted_, taken_;
  // What the tables on the device hold, and the words of them that the next packet changes.
  std::vector<int32_t> top_, pages_, tile_of_;
  struct Change {
    const Pool* pool;
    size_t index;
    int32_t value;
  };
  std::vector<Change> changes_;
  std::vector<uint32_t> resident_;  // per brick: bit 16 * layer + direction; brick 0 is none
  int32_t page_count_ = 1, tile_count_ = int32_t(CoverageTiles::k_fixed_tiles);
  Pool top_pool_, page_pool_, tile_table_;
  Pool visibility_{scalar::k_brick_cells}, depth_{scalar::k_brick_cells * sizeof(int32_t)},
      certificate_{scalar::k_brick_cells * sizeof(int32_t)}, sums_{CoverageTiles::k_tile_bytes},
      radiance_{CoverageTiles::k_radiance_bytes};
};

}  // namespace fieldtrace::gpu
