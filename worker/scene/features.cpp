#include "worker/scene/features.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "worker/scene/texture_refs.h"

namespace tessera::render {

namespace {

// Measured; see docs/notes/memory.md.
constexpr std::int64_t kAccelBytesPerTriangle = 75, kAccelBytesPerInstance = 256;
constexpr std::int64_t kMovingBytesPerTriangle = 120;  // of a deforming mesh, per motion segment
constexpr std::int64_t kBuildBytesPerTriangle = 130;   // temporary, for one mesh at a time
constexpr std::int64_t kLightBytesPerTriangle = 700;   // emissive triangles, per instance
constexpr std::int64_t kLightBytesPerTexel = 12;       // of emissive textures
constexpr std::int64_t kLightBytesPerEnvironmentTexel = 8;

constexpr std::uint64_t kNoFeature = 0;

template <typename Array>
std::int64_t bytes_in(const Array& v) {
  return static_cast<std::int64_t>(v.size() * sizeof(*v.data()));
}

std::uint64_t texture_features(const TextureRef& ref) {
  if (!ref) return 0;
  return kFeatureTextures | (ref.has_transform ? kFeatureTextureTransforms : kNoFeature) |
         (ref.uv_set == 1 ? kFeatureSecondUvSet : kNoFeature);
}

bool emits(const Material& m) {
  return !m.unlit && max_component(m.emission) > 0;
}

bool glows(const Medium& m) {
  return max_component(m.emission) > 0;
}

bool is_solid_glass(const Material& m) {
  return m.transmission > 0 && m.has_volume;
}

std::uint64_t material_features(const Material& m) {
  std::uint64_t f = 0;
  for (const TextureRef* ref : texture_refs(m)) f |= texture_features(*ref);
  if (m.normal_texture || m.clearcoat.normal_texture) f |= kFeatureNormalMaps;
  if (m.alpha_mode == AlphaMode::mask) f |= kFeatureAlphaMask;
  if (m.alpha_mode == AlphaMode::blend) f |= kFeatureAlphaBlend;
  if (m.unlit) f |= kFeatureUnlit;
  if (m.specular_glossiness) f |= kFeatureSpecularGlossiness;
  if (m.specular != 1 || m.specular_texture || m.specular_color_texture ||
      m.specular_color != Vec3f{1, 1, 1}) {
    f |= kFeatureSpecular;
  }
  if (m.transmission > 0) f |= m.has_volume ? kFeatureVolumes : kFeatureThinTransmission;
  if (emits(m)) f |= kFeatureEmissiveTriangles;
  if (m.clearcoat.factor > 0) f |= kFeatureClearcoat;
  if (m.anisotropy.strength > 0) f |= kFeatureAnisotropy;
  if (max_component(m.sheen.color) > 0) f |= kFeatureSheen;
  if (m.dispersion > 0 && is_solid_glass(m)) f |= kFeatureDispersion;
  if (m.iridescence.factor > 0) f |= kFeatureIridescence;
  if (m.optics.conductor || m.optics.exact_fresnel || m.optics.diffuse_roughness > 0) {
    f |= kFeatureOptics;
  }
  if (m.medium || m.optics.has_priority) f |= kFeatureMedia;
  if (m.medium && glows(*m.medium)) f |= kFeatureEmissiveMedia;
  if (m.diffuse_transmission.factor > 0) {
    f |= kFeatureDiffuseTransmission | (m.has_volume ? kFeatureVolumes : kNoFeature);
  }
  return f;
}

std::uint64_t scene_features(const Scene& scene) {
  std::uint64_t f = 0;
  if (!scene.lights.empty()) f |= kFeaturePunctualLights;
  if (scene.has_environment) {
    f |= scene.environment.image == kNone ? kFeatureConstantEnvironment : kFeatureEnvironmentMap;
  }
  if (scene.instances.size() > scene.meshes.size()) f |= kFeatureInstances;
  if (!scene.solids.empty()) f |= kFeatureCsg;
  if (scene.camera.kind == Camera::Kind::orthographic) f |= kFeatureOrthographicCamera;
  if (scene.camera.kind > Camera::Kind::orthographic) f |= kFeatureCurvedProjection;
  if (scene.camera.lens.radius > 0) f |= kFeatureLens;
  if (!scene.procedural_textures.empty()) f |= kFeatureProceduralTextures;
  if (scene.atmosphere) f |= kFeatureMedia;
  if (scene.atmosphere && glows(scene.atmosphere->medium)) f |= kFeatureEmissiveMedia;
  if (!scene.key_times.empty() || !scene.camera.keys.empty()) f |= kFeatureMotion;
  return f;
}

/// Bytes of the light sampling tables over texels of emissive textures and the environment map.
std::int64_t light_table_bytes(const Scene& scene, const std::vector<bool>& used_materials) {
  const auto texels = [&](std::int32_t image) {
    const Image& i = scene.images[static_cast<std::size_t>(image)];
    return std::int64_t{i.width} * i.height;
  };
  std::int64_t bytes = 0;
  for (std::size_t i = 0; i < scene.materials.size(); ++i) {
    const Material& m = scene.materials[i];
    if (!used_materials[i] || !emits(m) || !m.emissive_texture) continue;
    const std::int32_t image = scene.textures[m.emissive_texture.texture].image;
    if (image != kNone) bytes += kLightBytesPerTexel * texels(image);
  }
  if (scene.has_environment && scene.environment.image != kNone) {
    bytes += kLightBytesPerEnvironmentTexel * texels(scene.environment.image);
  }
  return bytes;
}

}  // namespace

std::int64_t geometry_bytes(const Primitive& p) {
  return bytes_in(p.positions) + bytes_in(p.triangles) + bytes_in(p.normals) +
         bytes_in(p.tangents) + bytes_in(p.uv[0]) + bytes_in(p.uv[1]) + bytes_in(p.colors);
}

SceneFeatures features_of(const Scene& scene) {
  SceneFeatures result;
  result.features = scene_features(scene);
  std::vector<bool> used(scene.materials.size());
  std::vector<std::int64_t> triangles(scene.meshes.size()), emissive(scene.meshes.size());
  for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
    for (const Primitive& p : scene.meshes[i].primitives) {
      const Material& material = scene.materials[p.material];
      const auto count = static_cast<std::int64_t>(p.triangles.size());
      triangles[i] += count;
      if (emits(material)) emissive[i] += count;
      const bool surface = count > 0 || scene.meshes[i].shape != nullptr;
      used[p.material] = used[p.material] || surface;
      if (surface) result.features |= material_features(material);
      if (!p.colors.empty()) result.features |= kFeatureVertexColors;
      result.vertices += static_cast<std::int64_t>(p.positions.size());
      result.geometry_bytes += geometry_bytes(p);
      ++result.primitives;
    }
    result.triangles += triangles[i];
    for (const SharedArray<Primitive>& key : scene.meshes[i].keys) {
      for (const Primitive& p : key) result.geometry_bytes += geometry_bytes(p);
    }
    if (!scene.meshes[i].keys.empty()) {  // one tree per motion segment, which bounds both ends
      result.acceleration_bytes += static_cast<std::int64_t>(scene.meshes[i].keys.size() - 1) *
                                   triangles[i] * kMovingBytesPerTriangle;
    }
    if (const Shape* shape = scene.meshes[i].shape.get(); shape != nullptr) {
      result.features |= kFeatureShapes | (shape->bounded() ? kNoFeature : kFeaturePlanes);
    }
  }
  for (const Instance& instance : scene.instances) {
    result.instanced_triangles += triangles[instance.mesh];
    result.emissive_triangles += emissive[instance.mesh];
  }
  for (const Image& image : scene.images) {
    result.image_bytes += bytes_in(image.u8) + bytes_in(image.u16) + bytes_in(image.f32);
  }
  for (const bool u : used) result.materials += u ? 1 : 0;
  for (const Texture& texture : scene.textures) result.textures += texture.image != kNone ? 1 : 0;
  result.meshes = static_cast<std::int64_t>(scene.meshes.size());
  result.instances = static_cast<std::int64_t>(scene.instances.size());
  result.images = static_cast<std::int64_t>(scene.images.size());
  result.lights = static_cast<std::int64_t>(scene.lights.size());
  const auto largest = std::max_element(triangles.begin(), triangles.end());
  result.acceleration_bytes += result.triangles * kAccelBytesPerTriangle +
                               result.instances * kAccelBytesPerInstance +
                               (largest == triangles.end() ? 0 : *largest * kBuildBytesPerTriangle);
  for (const auto& motion : scene.motions) {
    result.acceleration_bytes +=
        static_cast<std::int64_t>(motion.size()) *
        (kAccelBytesPerInstance + static_cast<std::int64_t>(3 * sizeof(Affine3d)));
  }
  result.light_bytes =
      result.emissive_triangles * kLightBytesPerTriangle + light_table_bytes(scene, used);
  return result;
}

std::vector<std::string> feature_names(std::uint64_t features) {
  static constexpr const char* kNames[] = {"textures",
                                           "normal-maps",
                                           "texture-transforms",
                                           "second-uv-set",
                                           "vertex-colors",
                                           "alpha-mask",
                                           "alpha-blend",
                                           "unlit",
                                           "specular-glossiness",
                                           "specular",
                                           "thin-transmission",
                                           "volumes",
                                           "emissive-triangles",
                                           "punctual-lights",
                                           "environment-map",
                                           "constant-environment",
                                           "instances",
                                           "orthographic-camera",
                                           "clearcoat",
                                           "anisotropy",
                                           "sheen",
                                           "dispersion",
                                           "iridescence",
                                           "diffuse-transmission",
                                           "curved-screen",
                                           "lens",
                                           "procedural-textures",
                                           "shapes",
                                           "csg",
                                           "exact-optics",
                                           "media",
                                           "motion",
                                           "emissive-media",
                                           "planes"};
  std::vector<std::string> out;
  for (std::size_t bit = 0; bit < std::size(kNames); ++bit) {
    if ((features >> bit & 1) != 0) out.emplace_back(kNames[bit]);
  }
  return out;
}

}  // namespace tessera::render
