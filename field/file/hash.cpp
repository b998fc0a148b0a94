#include "field/file/hash.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace fieldtrace {
namespace {

constexpr uint64_t k_c1 = 0x87c37b91114253d5u, k_c2 = 0x4cf5ad432745937fu;

uint64_t finalise(uint64_t k) {
  k ^= k >> 33;
  k *= 0xff51afd7ed558ccdu;
  k ^= k >> 33;
  k *= 0xc4ceb9fe1a85ec53u;
  return k ^ (k >> 33);
}

uint64_t scramble_first(uint64_t k) { return std::rotl(k * k_c1, 31) * k_c2; }
uint64_t scramble_second(uint64_t k) { return std::rotl(k * k_c2, 33) * k_c1; }

}  // namespace

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

void Hasher::mix_block(const unsigned char* block) {
  uint64_t k1, k2;
  std::memcpy(&k1, block, 8);
  std::memcpy(&k2, block + 8, 8);
  h1_ ^= scramble_first(k1);
  h1_ = (std::rotl(h1_, 27) + h2_) * 5 + 0x52dce729u;
  h2_ ^= scramble_second(k2);
  h2_ = (std::rotl(h2_, 31) + h1_) * 5 + 0x38495ab5u;
}

void Hasher::add(const void* data, size_t bytes) {
  const auto* at = static_cast<const unsigned char*>(data);
  const size_t held = size_t(length_ % k_block);
  length_ += bytes;
  if (held > 0) {
    const size_t taken = std::min(bytes, k_block - held);
    std::memcpy(rest_.data() + held, at, taken);
    at += taken;
    bytes -= taken;
    if (held + taken < k_block) return;
    mix_block(rest_.data());
  }
  for (; bytes >= k_block; at += k_block, bytes -= k_block) mix_block(at);
  if (bytes > 0) std::memcpy(rest_.data(), at, bytes);
}

Hash128 Hasher::result() const {
  std::array<unsigned char, k_block> tail = {};
  std::copy_n(rest_.begin(), length_ % k_block, tail.begin());
  uint64_t k1, k2;
  std::memcpy(&k1, tail.data(), 8);
  std::memcpy(&k2, tail.data() + 8, 8);
  // A zero tail scrambles to zero, as if the reference's switch had skipped it.
  uint64_t h1 = h1_ ^ scramble_first(k1) ^ length_, h2 = h2_ ^ scramble_second(k2) ^ length_;
  h1 += h2;
  h2 += h1;
  h1 = finalise(h1);
  h2 = finalise(h2);
  h1 += h2;
  h2 += h1;
  return {h1, h2};
}

}  // namespace fieldtrace
