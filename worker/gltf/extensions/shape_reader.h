#pragma once

#include <memory>
#include <optional>

#include "worker/geometry/shapes/shape.h"
#include "worker/gltf/file/json_view.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The shape that a TESSERA_shape object describes (docs/extensions.md). Faults, each with its
/// element: an unknown type or member, a dimension that is not above 0 or does not fit the others.
/// Null after a fault.
std::shared_ptr<const Shape> read_shape(const JsonView& look, JsonFault& fault);

/// The same of a TESSERA_blobs object.
std::shared_ptr<const Shape> read_blobs(const JsonView& look, JsonFault& fault);

/// The same of a TESSERA_terrain object.
std::shared_ptr<const Shape> read_terrain(const JsonView& look, JsonFault& fault);

/// The operation of a TESSERA_csg object; nullopt if it is absent or faulty.
std::optional<CsgOperation> read_csg(const JsonView& look, JsonFault& fault);

}  // namespace tessera::render
