#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"

namespace tessera::render {

/// Where a scene's bytes come from. The loader opens nothing itself: `inspect` reads a folder,
/// the renderer reads the descriptors it was given.
class ResourceReader {
 public:
  virtual ~ResourceReader() = default;
  /// The bytes named by `uri`, as written in the glTF file (percent-decoded), valid as long as
  /// the reader lives. Errors: NotFound, PermissionDenied (a path that leaves the scene's folder).
  virtual absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) = 0;
  /// Offers the texels of an image that has been decoded. What a scene's images take over what
  /// memory they may is copied elsewhere, to where it lies in memory only while it is looked at;
  /// null: they stay where they are. Any thread. Errors: ResourceExhausted.
  virtual absl::StatusOr<std::shared_ptr<const std::byte>> set_aside(
      std::span<const std::byte> /*texels*/) {
    return nullptr;
  }
};

}  // namespace tessera::render
