#include "field/file/field_trailer.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "core/io/input_file.h"
#include "core/platform/machine_memory.h"
#include "field/file/field_file.h"

namespace fieldtrace {
namespace {

constexpr size_t k_trailer_bytes = 32;
constexpr char k_magic[7] = {'F', 'T', 'F', 'I', 'E', 'L', 'D'};
// All formats up to 7 ended in one byte 1, whatever their number, and were hashed by MurmurHash3.
constexpr int k_version_up_to_7 = 1;
static_assert(k_field_format_version > 7 && k_field_format_version < 256, "one byte of the trailer");

void put_word(uint64_t value, char* out) {
  for (int i = 0; i < 8; ++i) out[i] = char(value >> (8 * i));
}

std::array<char, k_trailer_bytes> make_trailer(uint64_t bytes, const Hash128& hash) {
  std::array<char, k_trailer_bytes> trailer;
  std::memcpy(trailer.data(), k_magic, sizeof k_magic);
  trailer[sizeof k_magic] = char(k_field_format_version);
  put_word(bytes, trailer.data() + 8);
  put_word(hash.high, trailer.data() + 16);
  put_word(hash.low, trailer.data() + 24);
  return trailer;
}

int version_of(const char* trailer) { return uint8_t(trailer[sizeof k_magic]); }

}  // namespace

std::string other_format(int version) {
  const std::string found = version == k_version_up_to_7 ? "7 or earlier" : std::to_string(version);
  return "has field format version " + found + ", and this program reads " + std::to_string(k_field_format_version);
}

void append_trailer(const std::string& path, const std::string& name) {
  Hasher hasher;
  const std::optional<uint64_t> bytes = hasher.add_file(path);
  const std::array<char, k_trailer_bytes> trailer = make_trailer(bytes.value_or(0), hasher.result());
  std::ofstream out(path, std::ios::binary | std::ios::app);
  out.write(trailer.data(), trailer.size());
  out.close();
  if (!bytes || !out) throw Error({name}, std::string("cannot be written: ") + std::strerror(errno));
}

std::optional<int> trailer_version(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const std::streamoff bytes = in ? std::streamoff(in.tellg()) : 0;
  if (bytes < std::streamoff(k_trailer_bytes)) return std::nullopt;
  std::array<char, k_trailer_bytes> found;
  in.seekg(bytes - std::streamoff(k_trailer_bytes));
  in.read(found.data(), found.size());
  // The hash is not checked: that would take reading all of the file.
  auto expected = make_trailer(uint64_t(bytes) - k_trailer_bytes, {});
  expected[sizeof k_magic] = found[sizeof k_magic];
  if (!in || !std::equal(expected.begin(), expected.begin() + 16, found.begin())) return std::nullopt;
  return version_of(found.data());
}

std::string read_checked(const std::string& path) {
  if (is_special_file(path)) throw FieldFileError(path, k_special_file_message);
  if (is_folder(path)) throw FieldFileError(path, "is a folder");
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in && errno == ENOENT) throw MissingFieldFile(path);
  const std::streamoff end = in ? std::streamoff(in.tellg()) : -1;
  if (end < 0) throw FieldFileError(path, std::string("cannot be read: ") + std::strerror(errno));
  const auto size = uint64_t(end);
  if (size > machine_memory_bytes()) {
    throw FieldFileError(path, "is larger than the memory of this machine");
  }
  std::string contents(size, '\0');
  in.seekg(0);
  in.read(contents.data(), std::streamsize(contents.size()));
  if (!in) throw FieldFileError(path, "cannot be read to its end");
  const size_t bytes = contents.size() - k_trailer_bytes;
  if (contents.size() < k_trailer_bytes || std::memcmp(&contents[bytes], k_magic, sizeof k_magic) != 0) {
    throw FieldFileError(path, "is cut short, or no field file of this program");
  }
  // Told apart from damage before the hash, which earlier formats computed otherwise.
  const int version = version_of(&contents[bytes]);
  if (version != k_field_format_version) throw FieldFileError(path, other_format(version));
  Hasher hasher;
  hasher.add(contents.data(), bytes);
  const std::array<char, k_trailer_bytes> expected = make_trailer(bytes, hasher.result());
  if (std::memcmp(&contents[bytes], expected.data(), k_trailer_bytes) != 0) {
    throw FieldFileError(path, "is damaged (its checksum does not fit its contents)");
  }
  contents.resize(bytes);
  return contents;
}

}  // namespace fieldtrace
