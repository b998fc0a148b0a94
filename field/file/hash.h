// A 128-bit content hash: XXH3 (Collet, https://xxhash.com), fed piece by piece.
//
// It finds accidents (damage, another mesh), not attacks. Bytes are hashed as they lie in memory, so values of one
// field file are only compared between machines of the same byte order. No picture depends on it.
// Thread-safety: values; one Hasher serves one thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

struct XXH3_state_s;

namespace fieldtrace {

struct Hash128 {
  uint64_t high = 0, low = 0;

  bool operator==(const Hash128&) const = default;
  std::string hex() const;  // 32 lower-case digits, as `xxhsum -H128` prints them
};

// The inverse of Hash128::hex(). False, and `hash` unchanged, unless `text` is 32 hexadecimal digits.
bool parse_hash(const std::string& text, Hash128& hash);

class Hasher {
 public:
  // Throws std::bad_alloc if there is no memory for the state (half a kilobyte).
  Hasher();

  // Appends `bytes` bytes. The pieces may be cut anywhere: only their concatenation counts.
  void add(const void* data, size_t bytes);
  // A value without padding, by its bytes.
  template <class T>
  void add_value(const T& value) {
    add(&value, sizeof(T));
  }
  // A file's contents. Returns its size; nothing if it cannot be read to its end.
  [[nodiscard]] std::optional<uint64_t> add_file(const std::string& path);
  // The hash of everything added so far; more may be added afterwards.
  Hash128 result() const;

 private:
  struct FreeState {
    void operator()(XXH3_state_s* state) const;
  };
  std::unique_ptr<XXH3_state_s, FreeState> state_;
};

}  // namespace fieldtrace
