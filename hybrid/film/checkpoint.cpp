#include "hybrid/film/checkpoint.h"

#include <fmt/format.h>

#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "core/io/atomic_file.h"
#include "core/io/input_file.h"
#include "core/platform/error.h"
#include "field/file/hash.h"

namespace fieldtrace {
namespace {

constexpr char k_magic[] = "fieldtrace checkpoint 11\n";
constexpr size_t k_magic_size = sizeof(k_magic) - 1;
static_assert(std::is_trivially_copyable_v<StoredSums> && std::is_trivially_copyable_v<AovSums>);

// Sizes tell builds apart whose sums lie otherwise in memory.
std::string layout() {
  const uint16_t order = 1;
  const bool is_little = *reinterpret_cast<const uint8_t*>(&order) == 1;
  return std::to_string(sizeof(StoredSums)) + " " + std::to_string(sizeof(AovSums)) + (is_little ? " little" : " big");
}

// Calls f with the header's plain values and their names.
template <class C, class F>
void visit_header(C& c, const F& f) {
  f("planned_samples", c.planned_samples);
  f("expected_samples", c.expected_samples);
  f("accuracy", c.accuracy);
  f("field_mean_square", c.field_mean_square);
  f("light_samples", c.light_samples);
  f("open_light_samples", c.open_light_samples);
  f("lobe_samples", c.lobe_samples);
  f("reductions", c.reductions);
  f("tolerance", c.tolerance);
  f("decided", c.decided);
  f("decay", c.decay);
  f("first_mean_square", c.first_mean_square);
  f("round", c.round);
}

nlohmann::json header_of(const Checkpoint& c) {
  nlohmann::json j;
  j["layout"] = layout();
  j["identity"] = c.identity;
  visit_header(c, [&](const char* name, const auto& value) { j[name] = value; });
  j["window"] = {c.film.window.x, c.film.window.y, c.film.window.width, c.film.window.height};
  j["counts"] = c.counts.size();
  j["tiles"] = c.tiles_done.size();
  j["pixels"] = c.film.pixels.size();
  j["layers"] = c.film.aovs.size();
  return j;
}

// Reads what a file holds, from front to back.
class Reader {
 public:
  Reader(const std::string& path, std::string bytes) : path_(path), bytes_(std::move(bytes)) {}

  const char* take(uint64_t size) {
    if (size > bytes_.size() - at_) damaged();
    const char* const begin = bytes_.data() + at_;
    at_ += size;
    return begin;
  }
  template <class Vector>
  void take_array(Vector& values, uint64_t count) {
    constexpr size_t element = sizeof(typename Vector::value_type);
    if (count > bytes_.size() / element) damaged();
    values.resize(count);
    if (count > 0) std::memcpy(static_cast<void*>(values.data()), take(count * element), count * element);
  }
  bool at_end() const { return at_ == bytes_.size(); }
  [[noreturn]] void damaged() const {
    throw Error({path_}, "the checkpoint is damaged; render the picture again, or resume from another file");
  }

 private:
  const std::string& path_;
  std::string bytes_;
  size_t at_ = 0;
};

std::string read_bytes(const std::string& path) {
  const uint64_t size = require_regular_file(path);
  std::string bytes(size, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), std::streamsize(size))) throw Error({path}, "the checkpoint cannot be read");
  return bytes;
}

}  // namespace

std::vector<std::string> differences_of(const PictureIdentity& one, const PictureIdentity& other) {
  const std::map<std::string, std::string> ours(one.begin(), one.end()), theirs(other.begin(), other.end());
  std::vector<std::string> differences;
  const auto add = [&](const std::string& name, const std::string& here, const std::string& there) {
    const auto told = [](const std::string& value) { return value.empty() ? "nothing" : value; };
    if (there != here) differences.push_back(name + " is " + told(here) + " instead of " + told(there));
  };
  for (const auto& [name, here] : ours) {
    const auto found = theirs.find(name);
    add(name, here, found == theirs.end() ? "" : found->second);
  }
  for (const auto& [name, there] : theirs) {
    if (ours.count(name) == 0) add(name, "", there);
  }
  return differences;
}

void write_checkpoint(const std::string& path, const Checkpoint& c) {
  const std::string header = header_of(c).dump();
  const uint64_t header_size = header.size();
  AtomicFile atomic(path);
  CheckedFile file(atomic.temporary_path());
  Hasher hasher;
  const auto put = [&](const void* data, size_t bytes) {
    if (bytes == 0) return;
    hasher.add(data, bytes);
    file.write_at(file.end(), data, bytes);
  };
  put(k_magic, k_magic_size);
  put(&header_size, sizeof(header_size));
  put(header.data(), header.size());
  put(c.counts.data(), c.counts.size() * sizeof(uint32_t));
  put(c.tiles_done.data(), c.tiles_done.size());
  put(c.film.pixels.data(), c.film.pixels.size() * sizeof(StoredSums));
  put(c.film.aovs.data(), c.film.aovs.size() * sizeof(AovSums));
  const Hash128 hash = hasher.result();
  file.write_at(file.end(), &hash, sizeof(hash));
  file.close();
  if (file.failed()) throw Error({path}, "the checkpoint cannot be written: " + file.reason());
  atomic.commit();
}

Checkpoint read_checkpoint(const std::string& path, const PictureIdentity& identity) {
  std::string bytes = read_bytes(path);
  if (bytes.compare(0, k_magic_size, k_magic) != 0) throw Error({path}, "is not a checkpoint of this version");
  Hash128 hash;
  if (bytes.size() < k_magic_size + sizeof(hash)) Reader(path, {}).damaged();
  const size_t content = bytes.size() - sizeof(hash);
  std::memcpy(&hash, bytes.data() + content, sizeof(hash));
  Hasher hasher;
  hasher.add(bytes.data(), content);
  if (!(hasher.result() == hash)) Reader(path, {}).damaged();
  bytes.resize(content);
  Reader reader(path, std::move(bytes));
  reader.take(k_magic_size);
  uint64_t header_size = 0;
  std::memcpy(&header_size, reader.take(sizeof(header_size)), sizeof(header_size));
  const nlohmann::json j = nlohmann::json::parse(std::string(reader.take(header_size), header_size));
  if (j.at("layout") != layout())
    throw Error({path}, "the checkpoint was written by another build of the program; resume with that one");
  Checkpoint c;
  c.identity = j.at("identity").get<PictureIdentity>();
  const std::vector<std::string> differences = differences_of(identity, c.identity);
  if (!differences.empty())
    throw Error({path}, fmt::format("the checkpoint is of another picture: {}; resume with what was given then",
                                    fmt::join(differences, "; ")));
  visit_header(c, [&](const char* name, auto& value) { j.at(name).get_to(value); });
  const auto& w = j.at("window");
  c.film.window = {w.at(0), w.at(1), w.at(2), w.at(3)};
  reader.take_array(c.counts, j.at("counts"));
  reader.take_array(c.tiles_done, j.at("tiles"));
  reader.take_array(c.film.pixels, j.at("pixels"));
  reader.take_array(c.film.aovs, j.at("layers"));
  if (!reader.at_end()) reader.damaged();
  return c;
}

}  // namespace fieldtrace
