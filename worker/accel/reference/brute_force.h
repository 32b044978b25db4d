#pragma once

#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/solids/solids.h"
#include "worker/geometry/object_ray.h"
#include "worker/geometry/ray.h"
#include "worker/geometry/triangle.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Tests every triangle of one instance with the scalar test. Calls visit(hit) for each hit with
/// 0 <= t < t_max, in id order.
template <typename Visit>
void brute_force_mesh_hits(const Scene& scene, std::uint32_t i, const Ray& ray, Visit&& visit) {
  const Instance& instance = scene.instances[i];
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  const KeyframePosition at =
      scene.key_times.empty() ? KeyframePosition{} : find_key(scene.key_times, ray.time);
  Box3f bounds;
  for_each_triangle(mesh, at.segment,
                    [&](std::uint32_t, std::uint32_t, const MovingTriangle& triangle) {
                      bounds.extend(triangle.box());
                    });
  Affine3d world_to_object = instance.world_to_object;
  if (instance.motion != kNone) {
    const auto pose = pose_at(scene.motions[static_cast<std::size_t>(instance.motion)], at);
    if (!pose) return;
    world_to_object = pose->world_to_object;
  }
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!is_identity(world_to_object)) {
    transform_ray(world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ObjectRay object_ray;
  if (!make_object_ray(origin, direction, bounds, object_ray)) return;
  for_each_triangle(
      mesh, at.segment, [&](std::uint32_t p, std::uint32_t t, const MovingTriangle& triangle) {
        const TriangleId id = {i, p, t};
        const auto [v0, v1, v2] = triangle.at(at.f);
        TriangleHit hit{};
        if (id == ray.origin_triangle || !intersect_triangle(object_ray, v0, v1, v2, hit)) return;
        if (hit.t >= 0 && hit.t < ray.t_max) visit(Hit{hit.t, id, hit.b0, hit.b1, hit.b2});
      });
}

/// Reference for all acceleration structures (docs/explanation/determinism.md#closest-hit): tests
/// every triangle of every instance, and every solid. Slow. Calls visit(hit) for each hit with
/// 0 <= t < t_max, in the order of instances.
template <typename Visit>
void brute_force_hits(const Scene& scene, const Ray& ray, Visit&& visit) {
  if (!is_finite(ray.origin) || !is_finite(ray.direction) || !(ray.t_max > 0)) return;
  const std::shared_ptr<const Solids> solids = Solids::of(scene);
  const auto collect = [&](const Operand& operand, const Ray& mesh_ray, std::vector<Hit>& hits) {
    brute_force_mesh_hits(scene, operand.instance, mesh_ray,
                          [&](const Hit& hit) { hits.push_back(hit); });
  };
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (solids != nullptr && solids->at(i) != kNoSolid) {
      for (const Hit& hit : solids->hits(solids->at(i), ray, MeshHits(collect))) {
        if (hit.t < ray.t_max) visit(hit);
      }
    } else if (!scene.instances[i].operand) {
      brute_force_mesh_hits(scene, i, ray, visit);
    }
  }
}

/// Returns the result that SceneAccel::closest_hit must have.
inline bool brute_force_closest(const Scene& scene, const Ray& ray, Hit& hit) {
  bool found = false;
  brute_force_hits(scene, ray, [&](const Hit& candidate) {
    if (found && !precedes(candidate, hit)) return;
    hit = candidate;
    found = true;
  });
  return found;
}

}  // namespace tessera::render
