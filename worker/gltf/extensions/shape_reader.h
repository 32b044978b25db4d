#pragma once

#include <memory>
#include <optional>

#include "worker/geometry/shape.h"
#include "worker/gltf/file/json_view.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Bounds of the lengths in a shape, in units of its node; within them no product of three lengths
/// overflows or vanishes in double.
constexpr double kMaxShapeLength = 1e18, kMinShapeLength = 1e-18;

/// Reads a TESSERA_shape object (docs/reference/extensions/TESSERA_shape.md). Null after a fault:
/// an unknown type or property, or a dimension that is not positive or does not fit the others.
std::shared_ptr<const Shape> read_shape(const JsonView& object, JsonFault& fault);

/// Reads a TESSERA_blobs object; null after a fault.
std::shared_ptr<const Shape> read_blobs(const JsonView& object, JsonFault& fault);

/// Reads a TESSERA_terrain object; null after a fault.
std::shared_ptr<const Shape> read_terrain(const JsonView& object, JsonFault& fault);

/// Reads the operation of a TESSERA_csg object; nullopt if absent or faulty.
std::optional<CsgOperation> read_csg(const JsonView& object, JsonFault& fault);

}  // namespace tessera::render
