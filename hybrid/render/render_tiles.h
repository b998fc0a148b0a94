// The tiles of a picture, rendered by all threads.
#pragma once

#include <atomic>

#include "core/image/image.h"
#include "field/store/field_budget.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// What the tiles of one attempt share.
struct Job {
  const Picture& picture;
  const TransportContext& context;
  const FieldBudget& budget;
  Image& image;
  std::atomic<bool> interrupted = false;
  std::atomic<uint64_t> not_finite = 0;
};

// A black image of the picture's window and layers.
Image make_image(const Rect& window, const std::vector<Aov>& aovs);

// Renders all tiles, unless the budget or an interrupt stops it. Returns the workers' merged counters.
Stats render_tiles(Job& job);

// Warns of camera samples that were not finite, if there were any.
void warn_of_not_finite(const Job& job);

}  // namespace fieldtrace
