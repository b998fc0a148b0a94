#include "hybrid/film/slice.h"

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

// The bits of `column` at even places, those of `row` at odd ones.
uint64_t place_on_curve(uint32_t column, uint32_t row) {
  uint64_t place = 0;
  for (int bit = 0; bit < 32; ++bit)
    place |= uint64_t((column >> bit) & 1) << (2 * bit) | uint64_t((row >> bit) & 1) << (2 * bit + 1);
  return place;
}

// Numbers that do not fit are as good as the largest that do.
bool reads_as_number(const std::string& text, int64_t& number) {
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  if (error == std::errc::result_out_of_range) number = std::numeric_limits<int64_t>::max();
  return error != std::errc::invalid_argument && stop == end;
}

}  // namespace

std::string slice_text(const Slice& slice) { return std::to_string(slice.number) + "/" + std::to_string(slice.count); }

Slice parse_slice(const std::string& text) {
  const size_t bar = text.find('/');
  int64_t number = 0, count = 0;
  if (bar == std::string::npos || !reads_as_number(text.substr(0, bar), number) ||
      !reads_as_number(text.substr(bar + 1), count)) {
    throw UsageError("--slice " + text + ": write two whole numbers K/N, such as 1/4 for the first of 4 slices");
  }
  if (count < 1 || count > k_most_slices) {
    throw UsageError("--slice " + text + ": a picture has 1 to " + std::to_string(k_most_slices) +
                     " slices; write K/N with such an N");
  }
  if (number < 1 || number > count) {
    throw UsageError("--slice " + text + ": slices count from 1 to " + std::to_string(count) +
                     "; write K/N with such a K");
  }
  return {int(number), int(count)};
}

std::vector<int> slices_of_tiles(int columns, int rows, int count) {
  const size_t tiles = size_t(columns) * size_t(rows);
  std::vector<uint64_t> places(tiles);
  for (size_t i = 0; i < tiles; ++i)
    places[i] = place_on_curve(uint32_t(i % size_t(columns)), uint32_t(i / size_t(columns)));
  std::vector<size_t> order(tiles);
  std::iota(order.begin(), order.end(), size_t(0));
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return places[a] < places[b]; });
  std::vector<int> slices(tiles);
  for (size_t i = 0; i < tiles; ++i) slices[order[i]] = int(i % size_t(count)) + 1;
  return slices;
}

}  // namespace fieldtrace
