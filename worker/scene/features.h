#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/scene/scene.h"

namespace tessera::render {

/// Features that a posed scene uses; bits of SceneFeatures::features. A scene pays only for the
/// features it uses (docs/explanation/performance.md#features-cost-only-when-used).
enum Feature : std::uint32_t {
  kFeatureTextures = 1u << 0,
  kFeatureNormalMaps = 1u << 1,
  kFeatureTextureTransforms = 1u << 2,
  kFeatureSecondUvSet = 1u << 3,
  kFeatureVertexColors = 1u << 4,
  kFeatureAlphaMask = 1u << 5,
  kFeatureAlphaBlend = 1u << 6,
  kFeatureUnlit = 1u << 7,
  kFeatureSpecularGlossiness = 1u << 8,
  kFeatureSpecular = 1u << 9,
  kFeatureThinTransmission = 1u << 10,
  kFeatureVolumes = 1u << 11,
  kFeatureEmissiveTriangles = 1u << 12,
  kFeaturePunctualLights = 1u << 13,
  kFeatureEnvironmentMap = 1u << 14,
  kFeatureConstantEnvironment = 1u << 15,
  kFeatureInstances = 1u << 16,  // some mesh is placed more than once
  kFeatureOrthographicCamera = 1u << 17,
  kFeatureClearcoat = 1u << 18,
  kFeatureAnisotropy = 1u << 19,
  kFeatureSheen = 1u << 20,
  kFeatureDispersion = 1u << 21,
  kFeatureIridescence = 1u << 22,
  kFeatureDiffuseTransmission = 1u << 23,
  kFeatureCurvedProjection = 1u << 24,
  kFeatureLens = 1u << 25,
  kFeatureProceduralTextures = 1u << 26,
  kFeatureShapes = 1u << 27,
  kFeatureCsg = 1u << 28,
  kFeatureOptics = 1u << 29,
  kFeatureMedia = 1u << 30,   // media, also emissive, or priorities: paths keep a medium stack
  kFeatureMotion = 1u << 31,  // something moves during the exposure
};

/// Resident memory of a renderer before it loads a scene, measured.
inline constexpr std::int64_t kProcessBytes = 13'000'000;

/// Counts and sizes of a posed scene. Sizes are the peak of a renderer process with one frame
/// loaded, reached while it builds its tables. Sizes of arrays in the scene are exact, all others
/// are estimates.
struct SceneFeatures {
  std::uint32_t features = 0;
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

/// Determines the features and sizes of `scene`.
SceneFeatures features_of(const Scene& scene);

/// Names of the bits set in `features`, in ascending order ("textures", "alpha-mask", ...).
std::vector<std::string> feature_names(std::uint32_t features);

}  // namespace tessera::render
