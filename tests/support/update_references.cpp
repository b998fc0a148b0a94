// Renders the references of tests/references anew, shows what has changed, and replaces them if asked to: the program
// behind tools/update_references.sh.

#include <fmt/format.h>

#include <cstring>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/reference_scenes.h"

namespace fieldtrace::test {
namespace {

constexpr const char* k_usage =
    "usage: update_references [--write] [-o FOLDER] [SCENE...]\n"
    "  Renders the references (all, or those of the scenes named), compares them with the kept ones, and writes both, "
    "their\n"
    "  difference and its p-values into FOLDER (default: %s).\n"
    "  --write  then replaces the kept ones\n";

// How much larger the variance of blocks' means is than that of independent pixels; near 1 where the tests of blocks
// and of means hold what they promise.
double block_variance_ratio(const std::vector<Image>& images, const SampledPicture& picture) {
  double own = 0.0, expected = 0.0;
  for (int c = 0; c < 3; ++c) {
    double sum = 0.0, squares = 0.0;
    for (const Image& image : images) {
      double mean = 0.0;
      for (size_t i = c; i < image.data.size(); i += 3) mean += image.data[i];
      mean /= double(image.data.size() / 3);
      sum += mean;
      squares += mean * mean;
    }
    const double n = double(images.size());
    own += (squares - sum * sum / n) / (n - 1.0);
    for (size_t i = c; i < picture.variance.size(); i += 3) expected += picture.variance[i];
  }
  const double pixels = double(picture.variance.size() / 3);
  return own / (expected / (pixels * pixels));
}

void update(const ReferenceScene& scene, const std::string& folder, bool write) {
  const Renders renders = render_reference_scene(load_reference_scene(scene), scene, Method::monte_carlo,
                                                 k_reference_renders, k_first_reference_seed);
  const SampledPicture fresh = sampled_picture(renders.images);
  const std::string kept = reference_path(scene);
  fmt::print("{}: {} renders of {} x {} pixels; variance of the mean over that of independent pixels: {:.2f}\n",
             scene.name, fresh.renders, fresh.width, fresh.height, block_variance_ratio(renders.images, fresh));
  if (std::filesystem::exists(kept)) {
    const SampledPicture old = read_reference(kept);
    AgreementOptions options;
    options.comparisons = int(reference_scenes().size());
    const Agreement found = agreement(renders.images, old, options);
    fmt::print("  {} the kept one; {}\n", found.passed ? "agrees with" : "DIFFERS from", found.summary());
    for (const std::string& path : write_evidence(folder, scene.name, fresh, old, found)) fmt::print("  {}\n", path);
  } else {
    fmt::print("  is new: there is no {}\n", kept);
  }
  if (write) {
    write_reference(kept, fresh);
    fmt::print("  written: {} ({} bytes)\n", kept, std::filesystem::file_size(kept));
  }
  std::fflush(stdout);
}

int run(const std::vector<std::string>& arguments) {
  std::string folder = FIELDTRACE_EVIDENCE_DIR;
  bool write = false;
  std::vector<std::string> names;
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == "--write") {
      write = true;
    } else if (arguments[i] == "-o" && i + 1 < arguments.size()) {
      folder = arguments[++i];
    } else if (arguments[i].starts_with("-")) {
      std::fprintf(stderr, k_usage, FIELDTRACE_EVIDENCE_DIR);
      return 2;
    } else {
      names.push_back(arguments[i]);
    }
  }
  if (names.empty()) {
    for (const ReferenceScene& scene : reference_scenes()) names.push_back(scene.name);
  }
  for (const std::string& name : names) update(reference_scene(name), folder, write);
  if (!write) fmt::print("nothing was replaced; --write replaces the kept references\n");
  return 0;
}

}  // namespace
}  // namespace fieldtrace::test

int main(int count, char** values) {
  try {
    return fieldtrace::test::run({values + 1, values + count});
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fieldtrace: %s\n", e.what());
    return 1;
  }
}
