#include "worker/scene/needs.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "absl/strings/str_cat.h"
#include "worker/scene/document.h"

namespace tessera::render {

namespace {

// Measured: docs/performance.md, "Memory".
constexpr std::int64_t kAccelBytesPerTriangle = 75, kAccelBytesPerInstance = 256;
constexpr std::int64_t kMovingBytesPerTriangle = 120;  // of a mesh that changes, each segment
constexpr std::int64_t kBuildBytesPerTriangle = 130;   // of one mesh at a time
constexpr std::int64_t kLightBytesPerTriangle = 700;   // emissive, as often as it is placed
constexpr std::int64_t kLightBytesPerTexel = 12;       // of emissive textures
constexpr std::int64_t kLightBytesPerSkyTexel = 8;

template <typename Array>
std::int64_t bytes_in(const Array& v) {
  return static_cast<std::int64_t>(v.size() * sizeof(*v.data()));
}

std::int64_t bytes_of_primitive(const Primitive& p) {
  return bytes_in(p.positions) + bytes_in(p.triangles) + bytes_in(p.normals) +
         bytes_in(p.tangents) + bytes_in(p.uv[0]) + bytes_in(p.uv[1]) + bytes_in(p.colors);
}

std::uint32_t texture_features(const TextureRef& ref) {
  if (!ref) return 0;
  return kNeedsTextures | (ref.has_transform ? kNeedsTextureTransforms : 0u) |
         (ref.uv_set == 1 ? kNeedsSecondUvSet : 0u);
}

bool emits(const Material& m) {
  return !m.unlit && max_component(m.emission) > 0;
}

bool is_solid_glass(const Material& m) {
  return m.transmission > 0 && m.has_volume;
}

std::uint32_t material_features(const Material& m) {
  std::uint32_t f = 0;
  for (const TextureRef* ref : texture_refs(m)) f |= texture_features(*ref);
  if (m.normal_texture || m.clearcoat.normal_texture) f |= kNeedsNormalMaps;
  if (m.alpha_mode == AlphaMode::mask) f |= kNeedsAlphaMask;
  if (m.alpha_mode == AlphaMode::blend) f |= kNeedsAlphaBlend;
  if (m.unlit) f |= kNeedsUnlit;
  if (m.specular_glossiness) f |= kNeedsSpecularGlossiness;
  if (m.specular != 1 || m.specular_texture || m.specular_color_texture ||
      m.specular_color != Vec3f{1, 1, 1}) {
    f |= kNeedsSpecular;
  }
  if (m.transmission > 0) f |= m.has_volume ? kNeedsVolumes : kNeedsThinTransmission;
  if (emits(m)) f |= kNeedsEmissiveTriangles;
  if (m.clearcoat.factor > 0) f |= kNeedsClearcoat;
  if (m.anisotropy.strength > 0) f |= kNeedsAnisotropy;
  if (max_component(m.sheen.color) > 0) f |= kNeedsSheen;
  if (m.dispersion > 0 && is_solid_glass(m)) f |= kNeedsDispersion;
  if (m.iridescence.factor > 0) f |= kNeedsIridescence;
  if (m.optics.conductor || m.optics.exact_fresnel || m.optics.diffuse_roughness > 0) {
    f |= kNeedsOptics;
  }
  if (m.medium || m.optics.has_priority) f |= kNeedsMedia;
  if (m.diffuse_transmission.factor > 0) {
    f |= kNeedsDiffuseTransmission | (m.has_volume ? kNeedsVolumes : 0u);
  }
  return f;
}

std::uint32_t scene_features(const Scene& scene) {
  std::uint32_t f = 0;
  if (!scene.lights.empty()) f |= kNeedsPunctualLights;
  if (scene.has_environment) {
    f |= scene.environment.image == kNone ? kNeedsConstantEnvironment : kNeedsEnvironmentMap;
  }
  if (scene.instances.size() > scene.meshes.size()) f |= kNeedsInstances;
  if (!scene.solids.empty()) f |= kNeedsCsg;
  if (scene.camera.kind == Camera::Kind::orthographic) f |= kNeedsOrthographicCamera;
  if (scene.camera.kind > Camera::Kind::orthographic) f |= kNeedsCurvedScreen;
  if (scene.camera.lens.radius > 0) f |= kNeedsLens;
  if (!scene.procedures.empty()) f |= kNeedsProcedures;
  if (scene.atmosphere) f |= kNeedsMedia;
  if (!scene.key_times.empty() || !scene.camera.keys.empty()) f |= kNeedsMotion;
  return f;
}

/// Texels that the tables for choosing lights go over.
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
    bytes += kLightBytesPerSkyTexel * texels(scene.environment.image);
  }
  return bytes;
}

/// A triangle in recentred world space.
struct WorldTriangle {
  Vec3d a, b, c;
};

WorldTriangle world_triangle(const Instance& instance, const Primitive& p, std::size_t t) {
  const auto point = [&](std::uint32_t v) {
    return transform_point(instance.object_to_world, Vec3d(p.positions[v]));
  };
  return {point(p.triangles[t][0]), point(p.triangles[t][1]), point(p.triangles[t][2])};
}

/// Whether the segment o + f*d, f strictly inside (0, 1), crosses the triangle.
bool crosses(const WorldTriangle& t, const Vec3d& o, const Vec3d& d) {
  const Vec3d e1 = t.b - t.a, e2 = t.c - t.a, p = cross(d, e2);
  const double det = dot(e1, p);
  if (det == 0) return false;
  const Vec3d s = o - t.a, q = cross(s, e1);
  const double u = dot(s, p) / det, v = dot(d, q) / det, f = dot(e2, q) / det;
  constexpr double kNear = 1e-6;  // the segment starts on a surface
  return u >= 0 && v >= 0 && u + v <= 1 && f > kNear && f < 1 - kNear;
}

enum class Passage { open, through_glass, blocked };

/// How the segment from `o` along `d` fares among all triangles.
Passage passage(const Scene& scene, const Vec3d& o, const Vec3d& d) {
  Passage result = Passage::open;
  for (const Instance& instance : scene.instances) {
    for (const Primitive& p : scene.meshes[instance.mesh].primitives) {
      const Material& m = scene.materials[p.material];
      const bool clear =
          m.unlit || (m.transmission > 0 && !m.has_volume) || (m.medium && !is_solid_glass(m));
      if (clear || (is_solid_glass(m) && result == Passage::through_glass)) continue;
      for (std::size_t t = 0; t < p.triangles.size(); ++t) {
        if (!crosses(world_triangle(instance, p, t), o, d)) continue;
        if (!is_solid_glass(m)) return Passage::blocked;
        result = Passage::through_glass;
        break;
      }
    }
  }
  return result;
}

/// Centres of up to 64 triangles that are not glass, evenly spread over the scene's order.
std::vector<Vec3d> probe_points(const Scene& scene, std::int64_t triangles) {
  constexpr std::int64_t kProbes = 64;
  const std::int64_t stride = triangles / kProbes + 1;
  std::vector<Vec3d> out;
  std::int64_t index = 0;
  for (const Instance& instance : scene.instances) {
    for (const Primitive& p : scene.meshes[instance.mesh].primitives) {
      if (is_solid_glass(scene.materials[p.material])) continue;
      for (std::size_t t = 0; t < p.triangles.size(); ++t, ++index) {
        if (index % stride != 0) continue;
        const WorldTriangle w = world_triangle(instance, p, t);
        out.push_back((w.a + w.b + w.c) / 3.0);
      }
    }
  }
  return out;
}

/// From `point` to the light, or out of the scene against a directional one.
Vec3d towards(const PunctualLight& light, const Vec3d& point, double reach) {
  if (light.kind == PunctualLight::Kind::directional) return Vec3d(light.direction) * -reach;
  return light.position - point;
}

}  // namespace

SceneNeeds needs_of(const Scene& scene) {
  SceneNeeds needs;
  needs.features = scene_features(scene);
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
      if (surface) needs.features |= material_features(material);
      if (!p.colors.empty()) needs.features |= kNeedsVertexColors;
      needs.vertices += static_cast<std::int64_t>(p.positions.size());
      needs.geometry_bytes += bytes_of_primitive(p);
      ++needs.primitives;
    }
    needs.triangles += triangles[i];
    for (const SharedArray<Primitive>& key : scene.meshes[i].keys) {
      for (const Primitive& p : key) needs.geometry_bytes += bytes_of_primitive(p);
    }
    if (!scene.meshes[i].keys.empty()) {  // a tree from each key to the next, of both ends
      needs.acceleration_bytes += static_cast<std::int64_t>(scene.meshes[i].keys.size() - 1) *
                                  triangles[i] * kMovingBytesPerTriangle;
    }
    if (scene.meshes[i].shape != nullptr) needs.features |= kNeedsShapes;
  }
  for (const Instance& instance : scene.instances) {
    needs.instanced_triangles += triangles[instance.mesh];
    needs.emissive_triangles += emissive[instance.mesh];
  }
  for (const Image& image : scene.images) {
    needs.image_bytes += bytes_in(image.u8) + bytes_in(image.u16) + bytes_in(image.f32);
  }
  for (const bool u : used) needs.materials += u ? 1 : 0;
  for (const Texture& texture : scene.textures) needs.textures += texture.image != kNone ? 1 : 0;
  needs.meshes = static_cast<std::int64_t>(scene.meshes.size());
  needs.instances = static_cast<std::int64_t>(scene.instances.size());
  needs.images = static_cast<std::int64_t>(scene.images.size());
  needs.lights = static_cast<std::int64_t>(scene.lights.size());
  const auto largest = std::max_element(triangles.begin(), triangles.end());
  needs.acceleration_bytes += needs.triangles * kAccelBytesPerTriangle +
                              needs.instances * kAccelBytesPerInstance +
                              (largest == triangles.end() ? 0 : *largest * kBuildBytesPerTriangle);
  for (const auto& motion : scene.motions) {
    needs.acceleration_bytes +=
        static_cast<std::int64_t>(motion.size()) *
        (kAccelBytesPerInstance + static_cast<std::int64_t>(3 * sizeof(Affine3d)));
  }
  needs.light_bytes =
      needs.emissive_triangles * kLightBytesPerTriangle + light_table_bytes(scene, used);
  return needs;
}

std::vector<std::string> feature_names(std::uint32_t features) {
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
                                           "motion"};
  std::vector<std::string> out;
  for (std::size_t bit = 0; bit < std::size(kNames); ++bit) {
    if ((features >> bit & 1) != 0) out.emplace_back(kNames[bit]);
  }
  return out;
}

std::vector<Problem> check_light_through_glass(const Scene& scene) {
  std::vector<Problem> out;
  const SceneNeeds needs = needs_of(scene);
  if (scene.lights.empty() || (needs.features & kNeedsVolumes) == 0) return out;
  const std::vector<Vec3d> probes = probe_points(scene, needs.instanced_triangles);
  const double reach = 2 * length(scene.bounds_max - scene.bounds_min);
  for (const PunctualLight& light : scene.lights) {
    std::int64_t open = 0, through_glass = 0;
    for (const Vec3d& probe : probes) {
      const Passage way = passage(scene, probe, towards(light, probe, reach));
      open += way == Passage::open ? 1 : 0;
      through_glass += way == Passage::through_glass ? 1 : 0;
    }
    if (open > 0 || through_glass == 0) continue;
    out.push_back({Problem::Severity::warning, absl::StrCat("nodes[", light.node, "]"),
                   absl::StrCat("the light \"", light.name,
                                "\" reaches surfaces only through solid glass, where a point or "
                                "directional light cannot be found: it will not light them; use "
                                "an emissive surface, or thin glass (no thickness)")});
  }
  return out;
}

}  // namespace tessera::render
