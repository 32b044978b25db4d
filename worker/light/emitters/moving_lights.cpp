#include "worker/light/emitters/moving_lights.h"

#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/light/emitters/shape_light.h"

namespace tessera::render {
namespace {

const Mesh& mesh_of(const Scene& scene, const Instance& instance) {
  return scene.meshes[static_cast<std::size_t>(instance.mesh)];
}

const std::vector<Affine3d>& motion_of(const Scene& scene, const Instance& instance) {
  return scene.motions[static_cast<std::size_t>(instance.motion)];
}

/// Object to world at key `key`.
Affine3d place_at(const Scene& scene, const Instance& instance, std::size_t key) {
  return instance.motion == kNone ? instance.object_to_world : motion_of(scene, instance)[key];
}

/// Vertex k of a triangle in object space at a key.
Vec3d vertex_at(const Scene& scene, const TriangleId& id, std::size_t k, std::size_t key) {
  const Mesh& mesh = mesh_of(scene, scene.instances[id.instance]);
  const Primitive& p = mesh.primitives[id.primitive];
  const Primitive& now = mesh.keys.empty() ? p : mesh.keys[key][id.primitive];
  return Vec3d(now.positions[p.triangles[id.triangle][k]]);
}

}  // namespace

std::optional<Corners> corners_of(const Scene& scene, const TriangleId& id, float time) {
  const Instance& instance = scene.instances[id.instance];
  const auto pose = pose_of(scene, instance, time);
  if (!pose) return std::nullopt;
  const Mesh& mesh = mesh_of(scene, instance);
  const Primitive& p = mesh.primitives[id.primitive];
  const KeyframePosition at = find_key(scene.key_times, time);
  Corners corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t v = p.triangles[id.triangle][k];
    const Vec3f vertex =
        mesh.keys.empty()
            ? p.positions[v]
            : lerp_bounded(mesh.keys[at.segment][id.primitive].positions[v],
                           mesh.keys[at.segment + 1][id.primitive].positions[v], at.f);
    corners[k] = transform_point(pose->object_to_world, Vec3d(vertex));
  }
  return corners;
}

LightBounds bounds_of_moving(const Scene& scene, const TriangleId& id) {
  const Instance& instance = scene.instances[id.instance];
  std::vector<LightBounds> keys;
  Box3d between_keys;
  for (std::size_t key = 0; key < scene.key_times.size(); ++key) {
    const Affine3d now = place_at(scene, instance, key);
    Corners corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = transform_point(now, vertex_at(scene, id, k, key));
      if (key == 0) continue;
      const Affine3d before = place_at(scene, instance, key - 1);
      between_keys.extend((transform_point(before, vertex_at(scene, id, k, key)) +
                           transform_point(now, vertex_at(scene, id, k, key - 1))) *
                          0.5);
    }
    keys.push_back(bounds_of(corners, determinant(now) < 0));
  }
  LightBounds all = bounds_over(keys);
  all.box_min = min(all.box_min, between_keys.lo);
  all.box_max = max(all.box_max, between_keys.hi);
  return all;
}

LightBounds bounds_of_moving(const Scene& scene, const Instance& instance, double radiance,
                             bool both_sides) {
  std::vector<LightBounds> keys;
  for (const Affine3d& place : motion_of(scene, instance)) {
    const auto inverted = inverse(place);
    const Affine3d world_to_object = inverted.value_or(Affine3d());
    const ShapeLight emitter(place, world_to_object, *mesh_of(scene, instance).shape);
    keys.push_back(emitter.bounds(radiance, both_sides));
    if (!inverted) keys.back().strength = 0;  // invisible, but it moves from or to this place
  }
  return bounds_over(keys);
}

LightBounds bounds_of_moving(const PunctualLight& light) {
  std::vector<LightBounds> keys;
  for (const PunctualPose& pose : light.keys) keys.push_back(bounds_of(light, pose));
  return bounds_over(keys);
}

}  // namespace tessera::render
