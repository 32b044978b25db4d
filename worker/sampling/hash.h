#pragma once

#include <cstdint>

namespace tessera::render {

/// Bijection of 64-bit numbers in which every input bit affects about half of the output bits.
/// Source: D. Stafford's "Mix13" constants for MurmurHash3's finalizer, as in SplitMix64.
constexpr std::uint64_t mix(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// Combines `value` into `hash`; the order of calls matters. Start from any constant.
constexpr std::uint64_t combine(std::uint64_t hash, std::uint64_t value) {
  return mix(hash * 0x9e3779b97f4a7c15ULL + value + 0x632be59bd9b4e019ULL);
}

/// Two 32-bit values as one 64-bit one, for combine().
constexpr std::uint64_t pack(std::uint32_t high, std::uint32_t low) {
  return std::uint64_t{high} << 32 | low;
}

/// The top 24 of 32 bits as a float in [0, 1): every value is a multiple of 2^-24.
constexpr float unit_float(std::uint32_t bits) {
  return static_cast<float>(static_cast<std::int32_t>(bits >> 8)) * 0x1p-24f;
}

/// All 32 bits as the midpoint of one of 2^32 intervals of (0, 1).
constexpr double unit_double(std::uint32_t bits) {
  return (static_cast<double>(bits) + 0.5) * 0x1p-32;
}

/// unit_float() of the top bits of a 64-bit hash.
constexpr float unit_float(std::uint64_t hash) {
  return unit_float(static_cast<std::uint32_t>(hash >> 32));
}

}  // namespace tessera::render
