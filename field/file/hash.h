// A 128-bit content hash: MurmurHash3_x64_128 (Appleby 2011), computed piece by piece.
//
// Detects accidents (damage, another mesh), not attacks. Bytes are hashed as they lie in memory, so hashes are
// comparable only between machines of the same byte order. Thread-safety: values; one Hasher per thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace fieldtrace {

struct Hash128 {
  uint64_t high = 0, low = 0;

  bool operator==(const Hash128&) const = default;
  std::string hex() const;  // 32 lower-case digits
};

// The inverse of Hash128::hex(). False, and `hash` unchanged, unless `text` is 32 hexadecimal digits.
bool parse_hash(const std::string& text, Hash128& hash);

class Hasher {
 public:
  // Appends `bytes` bytes. Only the concatenation of all pieces counts, not where they are cut.
  void add(const void* data, size_t bytes);
  // A value without padding, by its bytes.
  template <class T>
  void add_value(const T& value) {
    add(&value, sizeof(T));
  }
  // The hash of everything added so far; more may be added afterwards.
  Hash128 result() const;

 private:
  static constexpr size_t k_block = 16;
  void mix_block(const unsigned char* block);

  uint64_t h1_ = 0, h2_ = 0;
  uint64_t length_ = 0;
  std::array<unsigned char, k_block> rest_ = {};  // length_ % 16 bytes that do not fill a block yet
};

}  // namespace fieldtrace
