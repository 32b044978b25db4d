#include "worker/accelerators/shadow_cache.h"

#include "worker/accel/build/mesh_triangles.h"

namespace tessera::render {

ShadowCache::ShadowCache(const Scene& scene, const SceneAccel& accel)
    : scene_(scene), accel_(accel) {
  for (const Mesh& mesh : scene.meshes) {
    Box3f& box = bounds_.emplace_back();
    for_each_triangle(
        mesh, [&](std::uint32_t, std::uint32_t, const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
          box.extend(v0);
          box.extend(v1);
          box.extend(v2);
        });
  }
}

bool ShadowCache::any_hit(const Ray& ray, std::uint32_t light, std::uint32_t depth,
                          const TriangleId& occluder) {
  TriangleId& last = last_[(light * 8 + depth) % last_.size()];
  if (!(last == TriangleId{}) && occludes(last, ray)) return true;
  if (!accel_.any_hit(ray)) return false;
  if (!(occluder == TriangleId{})) last = occluder;
  return true;
}

TriangleId ShadowCache::find_occluder(const Ray& ray) const {
  TriangleId occluder;
  accel_.any_hit(ray, [&](const Hit& hit) {
    const Instance& instance = scene_.instances[hit.id.instance];
    const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
    const bool still = instance.motion == kNone && mesh.keys.empty();
    if (mesh.shape == nullptr && still) occluder = hit.id;
    return true;
  });
  return occluder;
}

/// Tests one triangle in the same way as brute_force.h.
bool ShadowCache::occludes(const TriangleId& id, const Ray& ray) const {
  if (id == ray.origin_triangle) return false;
  const Instance& instance = scene_.instances[id.instance];
  const auto mesh = static_cast<std::size_t>(instance.mesh);
  const Primitive& primitive = scene_.meshes[mesh].primitives[id.primitive];
  const auto& [i0, i1, i2] = primitive.triangles[id.triangle];
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!is_identity(instance.world_to_object)) {
    transform_ray(instance.world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ObjectRay object_ray;
  TriangleHit hit{};
  return make_object_ray(origin, direction, bounds_[mesh], object_ray) &&
         intersect_triangle(object_ray, primitive.positions[i0], primitive.positions[i1],
                            primitive.positions[i2], hit) &&
         hit.t >= 0 && hit.t < ray.t_max;
}

}  // namespace tessera::render
