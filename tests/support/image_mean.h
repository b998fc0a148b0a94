// The mean of a picture's channel.
#pragma once

#include "core/image/image.h"

namespace fieldtrace::test {

inline double mean(const Image& image, size_t channel = 0) {
  double sum = 0.0;
  const size_t n = image.channel_count();
  for (size_t i = channel; i < image.data.size(); i += n) sum += double(image.data[i]);
  return sum / double(image.data.size() / n);
}

}  // namespace fieldtrace::test
