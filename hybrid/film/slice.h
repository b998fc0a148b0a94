// Slices of a picture: a fixed share of its tiles, for pictures that several machines render.
//
// Tiles are numbered along the Z-order curve (Morton 1966) of their columns and rows, and dealt to the slices in turn.
// So slices differ by one tile at most, in the whole picture and in every aligned square of 2^k x 2^k tiles within it:
// each gets its share of every region, whatever the number of slices and the width of the picture.
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

namespace fieldtrace {

struct Slice {
  int number = 1;  // from 1 to `count`
  int count = 1;
  bool operator==(const Slice&) const = default;
};

// More parts than this nobody merges: each is read as a whole picture.
inline constexpr int k_most_slices = 1 << 16;

// "K/N".
std::string slice_text(const Slice& slice);

// Reads "K/N". Throws UsageError, which says what is wrong, unless these are whole numbers and
// 1 <= K <= N <= k_most_slices.
Slice parse_slice(const std::string& text);

// The number of the slice that each tile of a grid belongs to, row by row. columns, rows >= 0; 1 <= count.
std::vector<int> slices_of_tiles(int columns, int rows, int count);

}  // namespace fieldtrace
