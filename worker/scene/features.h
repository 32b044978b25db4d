#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/scene/scene.h"

namespace tessera::render {

/// Features that a posed scene uses; bits of SceneFeatures::features. A scene pays only for the
/// features it uses (docs/explanation/performance.md#features-cost-only-when-used).
enum Feature : std::uint64_t {
  kFeatureTextures = 1ull << 0,
  kFeatureNormalMaps = 1ull << 1,
  kFeatureTextureTransforms = 1ull << 2,
  kFeatureSecondUvSet = 1ull << 3,
  kFeatureVertexColors = 1ull << 4,
  kFeatureAlphaMask = 1ull << 5,
  kFeatureAlphaBlend = 1ull << 6,
  kFeatureUnlit = 1ull << 7,
  kFeatureSpecularGlossiness = 1ull << 8,
  kFeatureSpecular = 1ull << 9,
  kFeatureThinTransmission = 1ull << 10,
  kFeatureVolumes = 1ull << 11,
  kFeatureEmissiveTriangles = 1ull << 12,
  kFeaturePunctualLights = 1ull << 13,
  kFeatureEnvironmentMap = 1ull << 14,
  kFeatureConstantEnvironment = 1ull << 15,
  kFeatureInstances = 1ull << 16,  // some mesh is placed more than once
  kFeatureOrthographicCamera = 1ull << 17,
  kFeatureClearcoat = 1ull << 18,
  kFeatureAnisotropy = 1ull << 19,
  kFeatureSheen = 1ull << 20,
  kFeatureDispersion = 1ull << 21,
  kFeatureIridescence = 1ull << 22,
  kFeatureDiffuseTransmission = 1ull << 23,
  kFeatureCurvedProjection = 1ull << 24,
  kFeatureLens = 1ull << 25,
  kFeatureProceduralTextures = 1ull << 26,
  kFeatureShapes = 1ull << 27,
  kFeatureCsg = 1ull << 28,
  kFeatureOptics = 1ull << 29,
  kFeatureMedia = 1ull << 30,          // media or priorities: paths keep a medium stack
  kFeatureMotion = 1ull << 31,         // something moves during the exposure
  kFeatureEmissiveMedia = 1ull << 32,  // some medium glows
  kFeaturePlanes = 1ull << 33,         // some shape is an infinite plane
};

/// Resident memory of a renderer before it loads a scene, measured.
inline constexpr std::int64_t kProcessBytes = 13'000'000;

/// Counts and sizes of a posed scene. Sizes are the peak of a renderer process with one frame
/// loaded, reached while it builds its tables. Sizes of arrays in the scene are exact, all others
/// are estimates.
struct SceneFeatures {
  std::uint64_t features = 0;
  std::int64_t triangles = 0;            // stored
  std::int64_t instanced_triangles = 0;  // counted once per instance
  std::int64_t vertices = 0, meshes = 0, primitives = 0, instances = 0;
  std::int64_t materials = 0;  // those that some surface uses
  std::int64_t textures = 0, images = 0, lights = 0;
  std::int64_t emissive_triangles = 0;  // instanced
  std::int64_t geometry_bytes = 0, image_bytes = 0;
  std::int64_t acceleration_bytes = 0;  // BVHs and the temporary memory for building the largest
  std::int64_t light_bytes = 0;  // light sampling tables: environment map, emissive triangles
  [[nodiscard]] std::int64_t total_bytes() const {
    return geometry_bytes + image_bytes + acceleration_bytes + light_bytes + kProcessBytes;
  }
};

/// Size of the arrays of a primitive, bytes.
std::int64_t geometry_bytes(const Primitive& primitive);

/// Determines the features and sizes of `scene`.
SceneFeatures features_of(const Scene& scene);

/// Names of the bits set in `features`, in ascending order ("textures", "alpha-mask", ...).
std::vector<std::string> feature_names(std::uint64_t features);

}  // namespace tessera::render
