#include "hybrid/film/part.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/platform/error.h"
#include "field/file/hash.h"
#include "hybrid/path/tiles.h"

namespace fieldtrace {
namespace {

using Json = nlohmann::json;
using Strings = std::map<std::string, std::string>;

constexpr char k_part[] = "fieldtrace:part", k_part_hash[] = "fieldtrace:part_hash";

// What is wrong with a file, without its name.
struct NoPart : std::runtime_error {
  using std::runtime_error::runtime_error;
};

Json rect_json(const Rect& r) { return {r.x, r.y, r.width, r.height}; }
Rect rect_of(const Json& j) { return {j.at(0), j.at(1), j.at(2), j.at(3)}; }

std::string part_text(const Part& part) {
  const Json j = {{"slice", part.slice.number},       {"of", part.slice.count},    {"window", rect_json(part.window)},
                  {"traced", rect_json(part.traced)}, {"identity", part.identity}, {"decided", part.decided},
                  {"channels", part.channels}};
  // A caller's strings need not be UTF-8.
  return j.dump(-1, ' ', /*ensure_ascii=*/true, Json::error_handler_t::replace);
}

Part part_of_json(const Json& j) {
  Part part;
  part.slice = {j.at("slice"), j.at("of")};
  part.window = rect_of(j.at("window"));
  part.traced = rect_of(j.at("traced"));
  part.identity = j.at("identity").get<PictureIdentity>();
  part.decided = j.at("decided").get<PictureIdentity>();
  part.channels = j.at("channels").get<std::vector<std::string>>();
  return part;
}

std::string hash_of(const std::string& text, const Image& image) {
  Hasher hasher;
  hasher.add(text.data(), text.size());
  hasher.add(image.data.data(), image.data.size() * sizeof(float));
  return hasher.result().hex();
}

// The image with its channels in that order. False if it has others.
bool put_in_order(Image& image, const std::vector<std::string>& channels) {
  if (channels == image.channels) return true;
  std::vector<size_t> from;
  for (const std::string& name : channels) {
    const int c = image.channel_index(name);
    if (c < 0) return false;
    from.push_back(size_t(c));
  }
  if (from.size() != image.channel_count()) return false;
  image = select_channels(image, from);
  return true;
}

// What the hash cannot tell: whether the program that wrote the part wrote what this one can use.
bool is_sound(const Part& part, const Image& image) {
  const Rect &w = part.window, &t = part.traced;
  // Tiles that cover the window reach less than a tile beyond it.
  const Rect most{w.x - k_tile_size, w.y - k_tile_size, w.width + 2 * k_tile_size, w.height + 2 * k_tile_size};
  return part.slice.count <= k_most_slices && part.slice.number >= 1 && part.slice.number <= part.slice.count &&
         w.width == image.width && w.height == image.height && is_inside(w, t) && is_inside(t, most);
}

struct ReadPart {
  Part part;
  Image image;
  Strings metadata;
};

// Throws NoPart.
ReadPart read_part(const std::string& path) {
  ReadPart read;
  ImageReadOptions options;
  options.metadata = &read.metadata;
  try {
    read.image = read_image(path, options);
  } catch (const Error& error) {
    const std::string message = error.what();
    throw NoPart(message.rfind(path + ": ", 0) == 0 ? message.substr(path.size() + 2) : message);
  }
  const auto text = read.metadata.find(k_part), hash = read.metadata.find(k_part_hash);
  if (text == read.metadata.end() || hash == read.metadata.end())
    throw NoPart("is no part of a picture; parts are written by `fieldtrace render --slice`");
  const auto damaged = [] { return NoPart("is damaged; render this slice again"); };
  try {
    const Json j = Json::parse(text->second);
    read.part = part_of_json(j);
    if (!put_in_order(read.image, read.part.channels) || hash_of(text->second, read.image) != hash->second)
      throw damaged();
  } catch (const Json::exception&) {
    throw damaged();
  }
  if (!is_sound(read.part, read.image)) throw NoPart("is a part of another version of the program");
  return read;
}

std::string what_differs(const Part& part, const Part& of_most) {
  std::vector<std::string> all;
  if (part.slice.count != of_most.slice.count)
    all.push_back("it is one of " + std::to_string(part.slice.count) + " slices, not of " +
                  std::to_string(of_most.slice.count));
  for (const auto& [one, other] : {std::pair(&part.identity, &of_most.identity), {&part.decided, &of_most.decided}}) {
    for (std::string& difference : differences_of(*one, *other)) all.push_back(std::move(difference));
  }
  if (all.empty()) all.emplace_back("it has other tiles or layers");
  return fmt::format("{}", fmt::join(all, ", "));
}

bool same_picture(const Part& a, const Part& b) {
  const auto same_rect = [](const Rect& p, const Rect& q) {
    return p.x == q.x && p.y == q.y && p.width == q.width && p.height == q.height;
  };
  return a.slice.count == b.slice.count && same_rect(a.window, b.window) && same_rect(a.traced, b.traced) &&
         a.identity == b.identity && a.decided == b.decided && a.channels == b.channels;
}

// Visits the pixels of a part's tiles within its window, a row of a tile at a time, as f(offset, values) of the image's
// data.
template <class F>
void for_rows_of(const Part& part, const F& f) {
  const size_t channels = part.channels.size();
  const std::vector<Rect> tiles = make_tiles(part.traced, k_tile_size);
  const Rect& w = part.window;
  const int columns = (part.traced.width + k_tile_size - 1) / k_tile_size;
  const std::vector<int> slices = slices_of_tiles(columns, int(tiles.size()) / columns, part.slice.count);
  for (size_t i = 0; i < tiles.size(); ++i) {
    if (slices[i] != part.slice.number) continue;
    const Rect& tile = tiles[i];
    const int left = std::max(tile.x, w.x), right = std::min(tile.x + tile.width, w.x + w.width);
    if (left >= right) continue;
    for (int y = std::max(tile.y, w.y); y < std::min(tile.y + tile.height, w.y + w.height); ++y) {
      const size_t first = size_t(y - w.y) * size_t(w.width) + size_t(left - w.x);
      f(first * channels, size_t(right - left) * channels);
    }
  }
}

// A part, with what its own tiles hold alone.
struct HeldPart {
  std::string path;
  Part part;
  Strings metadata;
  std::vector<float> values;
};

HeldPart hold(const std::string& path) {
  ReadPart read = read_part(path);
  HeldPart held{path, std::move(read.part), std::move(read.metadata), {}};
  for_rows_of(held.part, [&](size_t offset, size_t count) {
    const auto from = read.image.data.begin() + std::ptrdiff_t(offset);
    held.values.insert(held.values.end(), from, from + std::ptrdiff_t(count));
  });
  return held;
}

// The part whose picture most parts are of; the first of those where several are.
const HeldPart& most_common(const std::vector<HeldPart>& parts) {
  const HeldPart* best = nullptr;
  std::ptrdiff_t most = 0;
  std::vector<const HeldPart*> pictures;
  for (const HeldPart& p : parts) {
    if (std::any_of(pictures.begin(), pictures.end(), [&](auto* q) { return same_picture(q->part, p.part); })) continue;
    pictures.push_back(&p);
    const auto same = [&](const HeldPart& q) { return same_picture(q.part, p.part); };
    const std::ptrdiff_t count = std::count_if(parts.begin(), parts.end(), same);
    if (count > most) best = &p, most = count;
  }
  return *best;
}

// "3, 5 to 7", of numbers that rise.
std::string ranges_text(const std::vector<int>& numbers) {
  std::vector<std::string> ranges;
  for (size_t i = 0; i < numbers.size();) {
    size_t end = i + 1;
    while (end < numbers.size() && numbers[end] == numbers[end - 1] + 1) ++end;
    const std::string first = std::to_string(numbers[i]);
    ranges.push_back(end == i + 1 ? first : first + " to " + std::to_string(numbers[end - 1]));
    i = end;
  }
  return fmt::format("{}", fmt::join(ranges, ", "));
}

}  // namespace

void write_part(const std::string& path, const Image& image, const Part& part, const Strings& metadata) {
  ImageWriteOptions options;
  options.half = false;
  options.metadata = metadata;
  const std::string text = part_text(part);
  options.metadata[k_part] = text;
  options.metadata[k_part_hash] = hash_of(text, image);
  write_image(path, image, options);
}

bool holds_part(const std::string& path, const Part& part) {
  try {
    const Part wanted = part_of_json(Json::parse(part_text(part)));  // as it would be read
    Part found = read_part(path).part;
    found.decided = wanted.decided;
    return found.slice == wanted.slice && same_picture(found, wanted);
  } catch (const NoPart&) {
    return false;
  }
}

MergedPicture merge_parts(const std::vector<std::string>& paths) {
  std::vector<HeldPart> parts;
  std::vector<std::string> faults;
  for (const std::string& path : paths) {
    try {
      parts.push_back(hold(path));
    } catch (const NoPart& fault) {
      faults.push_back(path + ": " + fault.what());
    }
  }
  if (parts.empty()) throw Error(fmt::format("{}", fmt::join(faults, "; ")));
  const HeldPart& first = most_common(parts);
  const int count = first.part.slice.count;
  std::vector<const HeldPart*> by_slice(size_t(count), nullptr);
  for (const HeldPart& p : parts) {
    if (!same_picture(p.part, first.part)) {
      faults.push_back(p.path + ": is a part of another picture than " + first.path + ": " +
                       what_differs(p.part, first.part));
      continue;
    }
    const HeldPart*& there = by_slice[size_t(p.part.slice.number - 1)];
    if (there) {
      faults.push_back(p.path + ": is slice " + slice_text(p.part.slice) + ", as " + there->path +
                       "; give one of them");
    }
    there = &p;
  }
  std::vector<int> missing;
  for (int i = 0; i < count; ++i) {
    if (!by_slice[size_t(i)]) missing.push_back(i + 1);
  }
  if (!missing.empty()) {
    faults.push_back("slice" + std::string(missing.size() > 1 ? "s " : " ") + ranges_text(missing) + " of " +
                     std::to_string(count) + (missing.size() > 1 ? " are missing" : " is missing"));
  }
  if (!faults.empty()) throw Error(fmt::format("{}", fmt::join(faults, "; ")));
  MergedPicture merged;
  merged.slices = count;
  merged.metadata = by_slice[0]->metadata;
  merged.image.width = first.part.window.width;
  merged.image.height = first.part.window.height;
  merged.image.channels = first.part.channels;
  merged.image.data.resize(size_t(merged.image.width) * size_t(merged.image.height) * first.part.channels.size());
  for (const HeldPart* p : by_slice) {
    auto from = p->values.begin();
    for_rows_of(p->part, [&](size_t offset, size_t values) {
      std::copy_n(from, values, merged.image.data.begin() + std::ptrdiff_t(offset));
      from += std::ptrdiff_t(values);
    });
  }
  return merged;
}

std::optional<Slice> slice_of(const Strings& metadata) {
  const auto text = metadata.find(k_part);
  if (text == metadata.end()) return std::nullopt;
  try {
    const Json j = Json::parse(text->second);
    return Slice{j.at("slice"), j.at("of")};
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace fieldtrace
