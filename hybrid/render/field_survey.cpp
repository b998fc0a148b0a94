#include "hybrid/render/field_survey.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>

#include "core/platform/parallel.h"
#include "hybrid/path/tiles.h"

namespace fieldtrace {
namespace {

// At most this many blocks along each side of the film, and at most one in k_block_distance block widths.
constexpr int k_most_blocks = 16;
constexpr int k_block_distance = 3;
// Blocks shrink, to 4 x 4 pixels at least, where the film would hold fewer along its shorter side.
constexpr int k_fewest_blocks = 4;

// Pixels along a block's side, so that its rays to all lights fill a few packets whatever their number.
int block_side(const Rect& film, int64_t light_samples) {
  int side = light_samples >= 16 ? 4 : light_samples >= 4 ? 8 : 16;
  while (side > 4 && std::min(film.width, film.height) < k_fewest_blocks * k_block_distance * side) side /= 2;
  return side;
}

int blocks_along(int pixels, int side) { return std::clamp(pixels / (side * k_block_distance), 1, k_most_blocks); }

// Each block lies about the middle of its share of the film, at multiples of 4 pixels like the blocks of tile_pixels().
std::vector<Rect> survey_blocks(const Rect& film, int64_t light_samples) {
  const int side = block_side(film, light_samples);
  const int columns = blocks_along(film.width, side), rows = blocks_along(film.height, side);
  const auto place = [side](int i, int count, int pixels) {
    const int middle = int((2 * int64_t(i) + 1) * pixels / (2 * int64_t(count)));
    return std::clamp(middle - side / 2, 0, std::max(pixels - side, 0)) / 4 * 4;
  };
  std::vector<Rect> blocks;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const int x = place(i, columns, film.width), y = place(j, rows, film.height);
      blocks.push_back({film.x + x, film.y + y, std::min(side, film.width - x), std::min(side, film.height - y)});
    }
  }
  return blocks;
}

}  // namespace

FieldSurvey survey_fields(const TransportContext& context, const Rect& film, double repeats,
                          const std::function<bool()>& goes_on) {
  FieldSurvey survey;
  const int64_t lights = std::max(int64_t(context.scene.emitters.size()), int64_t(1));
  const std::vector<Rect> blocks = survey_blocks(film, lights * context.settings.light_samples);
  std::atomic<bool> interrupted = false;
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
  parallel_for_isolated(blocks.size(), [&](size_t i) {
    if (interrupted || !goes_on()) {
      interrupted = true;
      return;
    }
    const std::vector<PixelPosition> pixels = tile_pixels(blocks[i]);
    CameraSamples samples;
    samples.resize(pixels.size());
    for (size_t p = 0; p < pixels.size(); ++p) samples.set(p, uint32_t(pixels[p].x), uint32_t(pixels[p].y), 0);
    std::vector<Rgb> radiance(samples.size);
    workers.local().trace(samples, radiance);
  });
  survey.interrupted = interrupted;
  uint64_t pixels = 0;
  for (const Rect& b : blocks) pixels += uint64_t(b.width) * uint64_t(b.height);
  survey.scale = double(film.width) * double(film.height) * repeats / double(pixels);
  for (const TransportWorker& worker : workers) survey.stats.merge_counters(worker.stats());
  survey.uses = survey.stats.field_uses;
  survey.uses.resize(context.scene.shapes.size());
  return survey;
}

}  // namespace fieldtrace
