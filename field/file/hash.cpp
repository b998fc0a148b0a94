#include "field/file/hash.h"

#include <xxhash.h>

#include <fstream>
#include <new>
#include <vector>

namespace fieldtrace {

std::string Hash128::hex() const {
  static const char* const digits = "0123456789abcdef";
  std::string text;
  for (const uint64_t half : {high, low}) {
    for (int shift = 60; shift >= 0; shift -= 4) text += digits[(half >> shift) & 15];
  }
  return text;
}

bool parse_hash(const std::string& text, Hash128& hash) {
  if (text.size() != 32) return false;
  uint64_t half[2] = {0, 0};
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const int digit = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
    if (digit < 0) return false;
    half[i / 16] = half[i / 16] << 4 | uint64_t(digit);
  }
  hash = {half[0], half[1]};
  return true;
}

Hasher::Hasher() : state_(XXH3_createState()) {
  if (!state_) throw std::bad_alloc();
  XXH3_128bits_reset(state_.get());
}

void Hasher::FreeState::operator()(XXH3_state_s* state) const { XXH3_freeState(state); }

void Hasher::add(const void* data, size_t bytes) { XXH3_128bits_update(state_.get(), data, bytes); }

std::optional<uint64_t> Hasher::add_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<char> piece(1 << 20);
  uint64_t bytes = 0;
  while (file.read(piece.data(), std::streamsize(piece.size())), file.gcount() > 0) {
    add(piece.data(), size_t(file.gcount()));
    bytes += uint64_t(file.gcount());
  }
  return file.eof() ? std::optional(bytes) : std::nullopt;
}

Hash128 Hasher::result() const {
  const XXH128_hash_t hash = XXH3_128bits_digest(state_.get());
  return {hash.high64, hash.low64};
}

}  // namespace fieldtrace
