#pragma once

#include <cstddef>
#include <cstdint>

namespace tessera::render {

/// What a scene file may ask for at most (farm.md, section 9); checked before anything is
/// allocated.
inline constexpr std::size_t kMaxJsonBytes = std::size_t{64} << 20;
inline constexpr int kMaxJsonDepth = 64;
inline constexpr std::size_t kMaxNodes = 1'000'000;
inline constexpr std::size_t kMaxInstances = 4'000'000;
inline constexpr std::int64_t kMaxImageSide = 32'768;
inline constexpr std::int64_t kMaxImageBytes = std::int64_t{2} << 30;
/// Largest decoded size of one compressed view or primitive, and of one accessor.
inline constexpr std::uint64_t kMaxDecodedBytes = std::uint64_t{4} << 30;
/// Largest decoded size of an accessor without a view: zeros that no byte of the file pays for.
inline constexpr std::uint64_t kMaxZeroBytes = std::uint64_t{64} << 20;
/// What all accessors, the posed geometry, and all images may decode to. Files that name the same
/// bytes over and over are refused before they take hours.
inline constexpr std::uint64_t kMaxAccessorBytes = std::uint64_t{16} << 30;  // + 16 x the buffers
inline constexpr std::uint64_t kMaxGeometryBytes = std::uint64_t{64} << 30;
inline constexpr std::uint64_t kMaxAllImageBytes = std::uint64_t{32} << 30;
/// Problems kept of one file; beyond these, one line says so.
inline constexpr std::size_t kMaxProblems = 1000;
/// Largest magnitude of a coordinate; beyond it squares of lengths overflow in float.
inline constexpr double kMaxCoordinate = 1e18;

}  // namespace tessera::render
