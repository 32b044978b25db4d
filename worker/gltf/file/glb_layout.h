#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

/// Layout of GLB files: glTF 2.0, chapter 4.
namespace tessera::render::glb {

inline constexpr std::uint32_t kMagic = 0x46546C67;      // "glTF"
inline constexpr std::uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
inline constexpr std::uint32_t kBinChunk = 0x004E4942;   // "BIN\0"
inline constexpr std::size_t kHeaderBytes = 12, kChunkHeaderBytes = 8;

/// The number at byte `at`, which must exist. glTF and all supported hosts are little endian.
inline std::uint32_t read_u32(std::span<const std::byte> bytes, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

}  // namespace tessera::render::glb
