#include "worker/inspect/light_through_glass.h"

#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/features.h"

namespace tessera::render {
namespace {

bool is_solid_glass(const Material& m) {
  return m.transmission > 0 && m.has_volume;
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

/// Returns whether the segment o + f*d, f strictly inside (0, 1), crosses the triangle.
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

/// What the segment from `o` along `d` crosses.
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

/// Centres of up to 64 triangles that are not glass, evenly spread over the scene.
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

/// Vector from `point` to the light, or out of the scene towards a directional light.
Vec3d towards(const PunctualLight& light, const Vec3d& point, double reach) {
  if (light.kind == PunctualLight::Kind::directional) return Vec3d(light.direction) * -reach;
  return light.position - point;
}

}  // namespace

std::vector<Problem> check_light_through_glass(const Scene& scene) {
  std::vector<Problem> out;
  const SceneFeatures features = features_of(scene);
  if (scene.lights.empty() || (features.features & kFeatureVolumes) == 0) return out;
  const std::vector<Vec3d> probes = probe_points(scene, features.instanced_triangles);
  const double reach = 2 * length(scene.bounds_max - scene.bounds_min);
  for (const PunctualLight& light : scene.lights) {
    std::int64_t open = 0, through_glass = 0;
    for (const Vec3d& probe : probes) {
      const Passage crossed = passage(scene, probe, towards(light, probe, reach));
      open += crossed == Passage::open ? 1 : 0;
      through_glass += crossed == Passage::through_glass ? 1 : 0;
    }
    if (open > 0 || through_glass == 0) continue;
    out.push_back({Problem::Severity::warning, absl::StrCat("nodes[", light.node, "]"),
                   absl::StrCat("the light \"", light.name,
                                "\" is enclosed by solid glass; point and directional lights "
                                "cannot be sampled through refraction and contribute nothing; use "
                                "an emissive surface, or thin glass (no thickness)")});
  }
  return out;
}

}  // namespace tessera::render
