// The tiles of a picture, rendered by all threads.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "core/image/image.h"
#include "field/store/field_budget.h"
#include "hybrid/film/film_sums.h"
#include "hybrid/path/tiles.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/render/picture.h"
#include "hybrid/transport/trace_pixels.h"

namespace fieldtrace {

// What the tiles of one attempt share.
struct Job {
  const Picture& picture;
  const TransportContext& context;
  const FieldBudget& budget;
  std::optional<Clock::time_point> deadline = {};  // begins no batch of camera samples after it
  std::atomic<bool> interrupted = false;
  std::atomic<bool> has_samples = false;  // of any tile, those of a resumed picture included
  std::atomic<uint64_t> not_finite = 0;
  bool keeps_at_end = false;  // writes its checkpoint once it is done, and none before

  bool timed_out() const { return deadline && Clock::now() >= *deadline; }
  bool goes_on() const { return !picture.stopped() && !budget.exceeded() && !timed_out(); }
};

// Camera samples that one pass over the tiles takes.
struct Pass {
  std::function<SampleRange(const PixelPosition&)> samples;  // of each pixel
  std::vector<size_t> tiles;                                 // indices into picture_tiles(), in order
  bool in_quarters = false;                                  // of what the ranges end with (PixelSums)
};

// What a pass adds up in a tile. `aovs` is empty if there are no layers of first hits.
struct TileSums {
  std::vector<PixelPosition> pixels;
  std::vector<SampleRange> ranges;
  bool in_quarters = false;
  std::vector<PixelSums> sums;
  std::vector<AovSums> aovs;

  // Adds samples of a run.
  void add(Job& job, const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit> firsts,
           const TransportWorker::Cost& cost);
};

// The pixels that a picture traces: its window, or more where pixels depend on their neighbours'.
Rect traced_pixels(const Picture& picture);

// Makes the sums of a tile, without samples yet.
void begin_tile(const Job& job, const Pass& pass, const Rect& tile, TileSums& sums);

// The tiles that a picture is traced in, row by row.
std::vector<Rect> picture_tiles(const Picture& picture);

// A black image of the picture's window and layers.
Image make_image(const Rect& window, const std::vector<Aov>& aovs);

// Traces a pass. `finished(tile, sums)` is called by any thread as tiles are finished; tiles that the budget, the
// deadline or an interrupt stops are left out, and job.interrupted set. `progress` is called likewise, with the number
// of finished tiles. Adds the workers' counters to `stats`.
void trace_tiles(Job& job, const Pass& pass, const std::function<void(size_t tile, const TileSums&)>& finished,
                 const std::function<void(size_t tiles)>& progress, Stats& stats);

// The same for a context whose answerer has a device (render_bands.cpp).
void trace_bands(Job& job, const Pass& pass, const std::function<void(size_t tile, const TileSums&)>& finished,
                 const std::function<void(size_t tiles)>& progress, Stats& stats);

// Renders all tiles, or those of the picture's slice, in one pass, unless the budget or an interrupt stops it.
void render_tiles(Job& job, Image& image, Stats& stats);

// Hands the part of `tile` (pixels of the film) within the window to callbacks.tile, if there is one.
void show_tile(const Picture& picture, const Rect& tile, const std::function<Rgb(const PixelPosition&)>& radiance);

// Writes a pixel of the window. `decay`: as for PixelSums::variance().
void write_pixel(const Picture& picture, const PixelPosition& p, const PixelSums& sums, const AovSums* aovs,
                 double decay, Image& image);

// Calls the picture's progress callback at most ten times a second, from one thread at a time, with shares that do not
// fall.
class Progress {
 public:
  explicit Progress(const RenderCallbacks& callbacks);
  ~Progress();
  void report(double share);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Warns of camera samples that were not finite, if there were any.
void warn_of_not_finite(const Job& job);

}  // namespace fieldtrace
