#pragma once

#include <cstddef>
#include <cstdint>

namespace tessera::render {

/// Limits of scene files (docs/reference/limits.md#scene-files), checked before memory is
/// allocated.
inline constexpr std::size_t kMaxJsonBytes = std::size_t{64} << 20;
inline constexpr int kMaxJsonDepth = 64;
inline constexpr std::size_t kMaxNodes = 1'000'000;
inline constexpr std::size_t kMaxInstances = 4'000'000;
inline constexpr std::int64_t kMaxImageSide = 32'768;
inline constexpr std::int64_t kMaxImageBytes = std::int64_t{2} << 30;
/// Maximum decoded size of a compressed view, of a primitive, and of an accessor.
inline constexpr std::uint64_t kMaxDecodedBytes = std::uint64_t{4} << 30;
/// Maximum decoded size of an accessor without a view, whose zeros take no bytes of the file: that
/// of a file without buffers, which grows by 16 times the size of the buffers up to the second.
inline constexpr std::uint64_t kMinZeroLimit = std::uint64_t{1} << 20;
inline constexpr std::uint64_t kMaxZeroLimit = std::uint64_t{64} << 20;
/// Maximum total decoded size of the accessors, of the posed geometry and of the images. They
/// reject files that name the same bytes many times and would take hours.
inline constexpr std::uint64_t kMaxAccessorBytes = std::uint64_t{1} << 30;  // + 16 x the buffers
inline constexpr std::uint64_t kMaxGeometryBytes = std::uint64_t{64} << 30;
inline constexpr std::uint64_t kMaxAllImageBytes = std::uint64_t{32} << 30;
/// Maximum number of problems recorded for a file; one more says that others were dropped.
inline constexpr std::size_t kMaxProblems = 1000;
/// Maximum magnitude of a coordinate; above it squared lengths overflow in float.
inline constexpr double kMaxCoordinate = 1e18;

}  // namespace tessera::render
