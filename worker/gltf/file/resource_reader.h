#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::render {

/// Source of a scene's files. The loader opens no files itself: `inspect` reads a directory, the
/// renderer reads the descriptors it was given.
class ResourceReader {
 public:
  virtual ~ResourceReader() = default;
  /// The bytes of `uri`, as written in the glTF file and percent-decoded; valid while the reader
  /// lives. Errors: NotFound, PermissionDenied (a path outside the scene's directory).
  virtual absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) = 0;
  /// Offers decoded texels for spilling. Returns a file-mapped copy once texture memory is
  /// exhausted, otherwise null. Thread-safe. Errors: ResourceExhausted.
  virtual absl::StatusOr<std::shared_ptr<const std::byte>> spill(
      std::span<const std::byte> /*texels*/) {
    return nullptr;
  }
  /// Memory that a scene may take, without files and what spill() returns, bytes.
  virtual std::uint64_t memory_bytes() const { return UINT64_MAX; }
};

}  // namespace tessera::render
