// What a few pixels of a picture by rounds show before it is begun: how many samples it will need, and how far what is
// not rays is off.
//
// Determinism: as pictures. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include "hybrid/path/transport_context.h"
#include "hybrid/render/picture.h"

namespace fieldtrace {

// Camera samples of a picture, by its measure of errors.
struct SampleCost {
  double variance = 0.0;  // of one sample, mean over pixels and channels
  double work = 0.0;      // of one sample: itself and its rays
  double seconds = 0.0;   // of one sample, of one thread

  // Work until noise is `mean_square`; infinite where that is not above 0.
  double work_to(double mean_square) const {
    return mean_square > 0.0 ? std::max(variance / mean_square, 1.0) * work : double(k_infinity);
  }
};

// A context in which rays answer everything.
class RayContext {
 public:
  RayContext(const Picture& picture, const Stage& stage);
  const TransportContext& context() const { return *context_; }

 private:
  std::unique_ptr<ShadowAnswerer> answerer_;
  std::unique_ptr<TransportContext> context_;
};

// Of camera samples in `context`, by blocks of pixels that a grid spreads over the window.
SampleCost survey_noise(const Picture& picture, const TransportContext& context);

// The mean square of how far pictures in `context` and by rays differ where noise is averaged away, from single pixels
// spread over the window; and what samples of either cost. `samples`: of each pixel.
struct FieldError {
  double mean_square = 0.0;
  SampleCost fields, rays;
};
FieldError survey_field_error(const Picture& picture, const TransportContext& context, const TransportContext& rays,
                              double samples);

}  // namespace fieldtrace
