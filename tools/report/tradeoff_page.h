// The page of `fieldtrace tradeoff`: what its tables hold as plots, pictures and words.
//
// Nothing is extrapolated: where Monte Carlo's measured errors end, the page says "more than" or "less than".
// Thread-safety: values; pure functions.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "hybrid/compare/tradeoff.h"

namespace fieldtrace {

// What the page is made from. Rows and pictures arrive as run_tradeoff() calls back.
struct TradeoffReport {
  std::string scene, command, machine, version;  // text
  int reference_spp = 0;
  Image reference;
  std::vector<TradeoffRow> rows;
  std::vector<std::string> lines;  // of tradeoff.csv, one for each row
  std::vector<TradeoffParts> parts;

  // One row's picture of each method; -1: there is none.
  struct Pair {
    int monte_carlo = -1, hybrid = -1;  // rows
    Image monte_carlo_image, hybrid_image;
  };
  Pair equal_error, equal_time;

  // Appends the row and its line. Keeps the pictures that are shown: those in a time, and of those to an error the one
  // with the `shown_target`-th error of its method.
  void add(const TradeoffRow& row, const Image& image, size_t shown_target);
};

// `scratch_folder`: as for png_data_uri().
std::string tradeoff_page(const TradeoffReport& report, const std::string& scratch_folder);

// The processor's name and its hardware threads, as far as the system tells.
std::string machine_text();

}  // namespace fieldtrace
