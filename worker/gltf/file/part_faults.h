#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "absl/status/status.h"

namespace tessera::render {

/// First fault of each part of a glTF file that a scene need not use: buffers, views, accessors,
/// images, samplers, textures, materials, meshes, skins, cameras, lights and animations. A scene is
/// refused only for faults of parts that it uses.
class PartFaults {
 public:
  /// Records the fault of the part in which `path` ("meshes[3].primitives[0].mode") lies, unless
  /// that part has one. Returns false if the path lies in no part: the fault concerns the whole
  /// file.
  bool add(std::string_view path, const absl::Status& fault);

  /// Fault of an element, kNone for none, of a root array ("meshes"), or of "lights"; nullptr if it
  /// has none.
  [[nodiscard]] const absl::Status* find(std::string_view section, std::int32_t index) const;
  [[nodiscard]] bool empty() const { return faults_.empty(); }

  /// Faults by part ("meshes[3]").
  [[nodiscard]] const std::map<std::string, absl::Status, std::less<>>& all() const {
    return faults_;
  }

 private:
  std::map<std::string, absl::Status, std::less<>> faults_;
};

}  // namespace tessera::render
