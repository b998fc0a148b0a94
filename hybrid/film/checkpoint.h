// What a render needs to go on later: the sums of its pixels, what was begun, and what had been decided.
//
// The file is a header in JSON, the sums as they lie in memory, and a hash of both; it is written whole or not at all.
// Sums of another build of the program, or of a machine of another byte order, are refused. Thread-safety: values.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hybrid/film/film_sums.h"

namespace fieldtrace {

// What a picture depends on, by the names of options ("--seed", "5").
using PictureIdentity = std::vector<std::pair<std::string, std::string>>;

// What `one` says differently from `other`: "--seed is 5 instead of 6".
std::vector<std::string> differences_of(const PictureIdentity& one, const PictureIdentity& other);

// What answers in a picture to an error, from the cheapest on; each errs less than the one before.
enum class FieldAccuracy : uint8_t {
  coarse_maps,  // direction maps for few samples, and fields
  usual,        // both as in pictures without a target error
  rays          // neither
};

struct Checkpoint {
  PictureIdentity identity;
  // Decisions: samples that a pixel was expected to need, by rays when fields were chosen, and with them; how
  // accurate fields are and how far they err; and light samples of each camera sample.
  int planned_samples = 1, expected_samples = 1;
  FieldAccuracy accuracy = FieldAccuracy::usual;
  double field_mean_square = 0.0;
  int light_samples = 1, open_light_samples = 1, lobe_samples = 1;
  uint32_t reductions = 0;  // of fields that had outgrown their memory (FieldPlan)

  float tolerance = 0.0f;        // of lights
  PictureIdentity decided = {};  // what depends on memory

  double decay = 1.0;  // of noise by samples, as surveys showed it (SampleAllocation::decay())
  // The noise of one sample of each pixel, as a survey showed it, if the first round takes no more; else 0.
  double first_mean_square = 0.0;

  uint32_t round = 0;               // the one that is being traced
  std::vector<uint32_t> counts;     // its samples of a pixel, by cell; by one number for all where there are no cells
  std::vector<uint8_t> tiles_done;  // its tiles
  FilmSums film;
};

// Throws Error if the file cannot be written.
void write_checkpoint(const std::string& path, const Checkpoint& checkpoint);

// Throws Error if the file cannot be read, is damaged, or belongs to another picture: the message names what differs.
Checkpoint read_checkpoint(const std::string& path, const PictureIdentity& identity);

}  // namespace fieldtrace
