#pragma once

#include "worker/gltf/file/json_view.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Reads TESSERA_material (docs/reference/extensions/TESSERA_material.md); defaults if absent.
/// Reports faults to `fault`.
Optics read_optics(const JsonView& object, JsonFault& fault);

}  // namespace tessera::render
