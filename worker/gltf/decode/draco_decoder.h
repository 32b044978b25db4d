#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// A triangle mesh decoded by Draco.
class DracoGeometry {
 public:
  /// Errors: InvalidArgument if the stream is damaged or not a mesh.
  static absl::StatusOr<std::unique_ptr<DracoGeometry>> decode(std::span<const std::byte> stream);
  ~DracoGeometry();

  [[nodiscard]] std::size_t points() const;
  [[nodiscard]] std::size_t triangles() const;
  /// Three 32-bit indices per triangle, each below points().
  [[nodiscard]] absl::StatusOr<std::vector<std::byte>> indices() const;
  /// Values of the attribute with Draco's unique id `id` for every point, tightly packed.
  [[nodiscard]] absl::StatusOr<std::vector<std::byte>> attribute(std::int64_t id,
                                                                 ComponentType type,
                                                                 int components) const;

 private:
  struct Parts;
  explicit DracoGeometry(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace tessera::render
