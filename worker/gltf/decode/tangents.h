#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/gltf/decode/geometry_reader.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Tangents by MikkTSpace's method, one a corner (three a triangle): unit, perpendicular to the
/// corner's normal unless the UVs there are degenerate (then +x), w the sign for bitangent =
/// cross(normal, tangent.xyz) * w. Corners with equal position, normal and UV that are connected by
/// triangles of the same UV orientation share one. Primitives without normals use those of their
/// faces. Source: M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008, section 2.4, and
/// the description of the method on mikktspace.com. V runs down in glTF, hence the sign of w.
std::vector<Vec4f> corner_tangents(const Primitive& primitive, std::int32_t uv_set);

/// Gives `base` tangents, splitting vertices whose corners differ in tangent; morph targets and
/// influences are split along. The UV set must have been read.
void add_tangents(BasePrimitive& base, std::int32_t uv_set);

/// Unit normal of a triangle by its winding; zero when it has no area.
Vec3f face_normal(const Primitive& primitive, const std::array<std::uint32_t, 3>& triangle);

}  // namespace tessera::render
