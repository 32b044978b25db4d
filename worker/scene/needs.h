#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/scene/loader.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// What a posed scene asks of a renderer. Bits of SceneNeeds::features; a scene pays only for
/// what it needs. What is chosen by them: docs/performance.md, "What choosing by needs gains".
enum Feature : std::uint32_t {
  kNeedsTextures = 1u << 0,
  kNeedsNormalMaps = 1u << 1,
  kNeedsTextureTransforms = 1u << 2,
  kNeedsSecondUvSet = 1u << 3,
  kNeedsVertexColors = 1u << 4,
  kNeedsAlphaMask = 1u << 5,
  kNeedsAlphaBlend = 1u << 6,
  kNeedsUnlit = 1u << 7,
  kNeedsSpecularGlossiness = 1u << 8,
  kNeedsSpecular = 1u << 9,
  kNeedsThinTransmission = 1u << 10,
  kNeedsVolumes = 1u << 11,
  kNeedsEmissiveTriangles = 1u << 12,
  kNeedsPunctualLights = 1u << 13,
  kNeedsEnvironmentMap = 1u << 14,
  kNeedsConstantEnvironment = 1u << 15,
  kNeedsInstances = 1u << 16,  // a mesh placed more than once
  kNeedsOrthographicCamera = 1u << 17,
  kNeedsClearcoat = 1u << 18,
  kNeedsAnisotropy = 1u << 19,
  kNeedsSheen = 1u << 20,
  kNeedsDispersion = 1u << 21,
  kNeedsIridescence = 1u << 22,
  kNeedsDiffuseTransmission = 1u << 23,
  kNeedsCurvedScreen = 1u << 24,
  kNeedsLens = 1u << 25,
  kNeedsProcedures = 1u << 26,
  kNeedsShapes = 1u << 27,
  kNeedsCsg = 1u << 28,
  kNeedsOptics = 1u << 29,
  kNeedsMedia = 1u << 30,   // or priorities: paths know all bodies they are in
  kNeedsMotion = 1u << 31,  // something moves while the shutter is open
};

/// Resident memory of a renderer before it has a scene, measured. A Radiance sky adds some 120 MB
/// of OpenImageIO's libraries, which all renderers of a host share.
inline constexpr std::int64_t kProcessBytes = 13'000'000;

/// Counts and sizes of a posed scene. Sizes are of a renderer process with one frame loaded, at its
/// largest, which is while it builds its tables; those that are not of arrays in the scene are
/// estimates.
struct SceneNeeds {
  std::uint32_t features = 0;
  std::int64_t triangles = 0;            // stored
  std::int64_t instanced_triangles = 0;  // seen: those of a mesh once per instance
  std::int64_t vertices = 0, meshes = 0, primitives = 0, instances = 0;
  std::int64_t materials = 0;  // used ones
  std::int64_t textures = 0, images = 0, lights = 0;
  std::int64_t emissive_triangles = 0;  // instanced
  std::int64_t geometry_bytes = 0, image_bytes = 0;
  std::int64_t acceleration_bytes = 0;  // trees, and the making of the largest
  std::int64_t light_bytes = 0;         // what lights are chosen by: sky, emissive triangles
  [[nodiscard]] std::int64_t total_bytes() const {
    return geometry_bytes + image_bytes + acceleration_bytes + light_bytes + kProcessBytes;
  }
};

SceneNeeds needs_of(const Scene& scene);

/// Names of the bits in `features`, in order of the bits ("textures", "alpha-mask", ...).
std::vector<std::string> feature_names(std::uint32_t features);

/// Warns of each punctual light that reaches surfaces only through solid glass. Next-event
/// estimation cannot see it there, and no path hits a point: such a room stays dark. Judged by
/// segments from at most 64 triangles' centres to the light; costs their number times the
/// instanced triangles, and nothing without both such materials and such lights.
std::vector<Problem> check_light_through_glass(const Scene& scene);

}  // namespace tessera::render
