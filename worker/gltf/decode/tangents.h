#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/gltf/decode/geometry_reader.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Tangents by MikkTSpace's method, one per corner (three per triangle): unit length, perpendicular
/// to the corner's normal unless its UVs are degenerate (then +x); w is the sign of the bitangent,
/// cross(normal, tangent.xyz) * w. Corners with equal position, normal and UV that are connected by
/// triangles of the same UV orientation share a tangent. Primitives without normals use those of
/// their faces. V points down in glTF, which determines the sign of w.
///
/// Source: M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008, section 2.4, and the
/// description on mikktspace.com.
std::vector<Vec4f> corner_tangents(const Primitive& primitive, std::int32_t uv_set);

/// Adds tangents to `base`, splitting vertices (with their morph targets and influences) whose
/// corners have different tangents. The UV set must have been read.
void add_tangents(BasePrimitive& base, std::int32_t uv_set);

/// Unit normal of a triangle by its winding; zero for a degenerate one.
Vec3f face_normal(const Primitive& primitive, const std::array<std::uint32_t, 3>& triangle);

}  // namespace tessera::render
