// A wave on its way: the questions that it takes, the arrays that they share, and the launches that answer them.
//
// Questions of one kind about the same occluder and light are one launch, whichever tiles they come from; so are all
// about skies.
// Thread-safety: those of one wave belong to one thread.
#pragma once

#include <memory>
#include <variant>
#include <vector>

#include "gpu/device_mirror.h"
#include "gpu/wave_arrays.h"
#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace::gpu {

static_assert(k_warp == k_batch_padding);

// A question as the device takes it.
struct Item {
  std::variant<ConeQuestion*, StratumQuestion*, RayQuestion*, LobeQuestion*, SkyQuestion*> question;
  MirrorSource source;          // of what its kernel reads of fields; of nothing: it reads none
  std::vector<uint32_t> warps;  // the blocks that are asked about, by their index in the question
  uint64_t samples = 0;
  size_t answered_before = 0;  // blocks
  bool is_asked = false;       // the device answers, as far as it can
  // Of the last wave: blocks that met what is not resident, with the places of the words that name it.
  struct Unbaked {
    uint32_t warp;
    size_t words;
  };
  std::vector<Unbaked> unbaked = {};
};

// What one wave sends and receives.
struct WaveBuffers {
  WaveBuffers(DeviceMemory& memory, Stream s, const DeviceTables& all_tables)
      : stream(s),
        tables(all_tables),
        in(memory),
        fields(memory),
        made(memory, StagingBuffer::Side::device),
        out(memory),
        missing(memory) {}
  const Stream stream;
  const DeviceTables& tables;
  StagingBuffer in, fields, made, out, missing;  // questions, packet, rays that are made on the device, answers
  WavePoints cone_points{WavePoints::Use::cones}, receivers{WavePoints::Use::light_samples};
  WaveRays rays;
  WaveLobes lobes;
};

// Some questions that one kernel answers.
class KernelLaunch {
 public:
  // `of`: MirrorSource::tiles.
  explicit KernelLaunch(const CoverageTiles* of) : tiles(of) {}
  virtual ~KernelLaunch() = default;
  // Puts what is its own into `in`, and makes room for the answers.
  virtual void stage(WaveBuffers& wave) = 0;
  // Once `in` stays where it is on the device: completes pointers into it.
  virtual void settle(WaveBuffers&) {}
  // `view`: the source's on the device.
  virtual void start(Runtime& runtime, const FieldView& view, const WaveBuffers& wave) const = 0;
  virtual void take_answers(const WaveBuffers& wave) = 0;

  const CoverageTiles* const tiles;
  bool is_started = false;
};

// Cells of skies (device_sky.cpp).
class SkyLaunch : public KernelLaunch {
 public:
  SkyLaunch() : KernelLaunch(nullptr) {}
  virtual void add(SkyQuestion& question) = 0;
};
std::unique_ptr<SkyLaunch> make_sky_launch();
void list_sky_tables(const SkyQuestion& question, std::vector<HostTable>& tables);

class WaveLaunches {
 public:
  void clear() { launches_.clear(), launch_of_.clear(), sky_ = nullptr; }
  // Adds those of `items` that are asked, with what they share.
  void add(std::span<Item* const> items, WaveBuffers& wave);
  std::span<const std::unique_ptr<KernelLaunch>> all() const { return launches_; }

 private:
  template <class Kind, class... Arguments>
  Kind& launch_for(const std::string& key, const Arguments&... arguments);

  std::vector<std::unique_ptr<KernelLaunch>> launches_;
  std::map<std::string, size_t> launch_of_;
  SkyLaunch* sky_ = nullptr;  // of launches_; null: none
};

// The tables that a question refers to.
void list_tables(const Item& item, std::vector<HostTable>& tables);

template <class Arguments>
void start_kernel(Runtime& runtime, const WaveBuffers& wave, Kernel kernel, const Arguments& arguments) {
  check(runtime, runtime.launch(wave.stream, kernel, arguments.warps, &arguments, sizeof arguments),
        "starting a kernel");
}

}  // namespace fieldtrace::gpu
