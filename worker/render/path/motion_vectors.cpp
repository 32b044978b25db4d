#include "worker/render/path/motion_vectors.h"

#include <cstddef>
#include <map>
#include <optional>
#include <utility>

#include "contract/index.h"
#include "worker/math/transform.h"
#include "worker/math/vector.h"

namespace tessera::render {
namespace {

/// 0 for distances beyond the largest image, which occur near the plane of the camera.
float limited(double pixels) {
  constexpr double kLargest = 65536;
  return pixels >= -kLargest && pixels <= kLargest ? static_cast<float>(pixels) : 0.0f;
}

/// Node and index among the node's instances, of each instance.
std::vector<std::pair<std::int32_t, std::int32_t>> instance_keys(const Scene& scene) {
  std::vector<std::pair<std::int32_t, std::int32_t>> keys;
  std::map<std::int32_t, std::int32_t> counts;
  for (const Instance& instance : scene.instances)
    keys.emplace_back(instance.node, counts[instance.node]++);
  return keys;
}

/// Where a point of an instance is in the recentred world.
std::optional<Vec3d> point_on(const Scene& scene, std::int32_t index, const Hit& hit) {
  if (index == kNone) return std::nullopt;
  const Instance& instance = scene.instances[contract::as_index(index)];
  const Mesh& mesh = scene.meshes[contract::as_index(instance.mesh)];
  const Vec3d b{hit.b0, hit.b1, hit.b2};
  if (mesh.shape != nullptr) return transform_point(instance.object_to_world, b);
  if (hit.id.primitive >= mesh.primitives.size()) return std::nullopt;
  const Primitive& primitive = mesh.primitives[hit.id.primitive];
  const std::uint32_t triangle = hit.id.triangle & ~kFlippedSide;
  if (triangle >= primitive.triangles.size()) return std::nullopt;
  Vec3d point;
  for (std::size_t k = 0; k < 3; ++k) {
    const double share = k == 0 ? b.x : k == 1 ? b.y : b.z;
    point = point + Vec3d(primitive.positions[primitive.triangles[triangle][k]]) * share;
  }
  return transform_point(instance.object_to_world, point);
}

}  // namespace

MotionVectors::MotionVectors(const Scene& scene, std::int32_t width, std::int32_t height)
    : scene_(scene),
      now_(moment(scene, width, height)),
      before_(moment(*scene.before, width, height)),
      after_(moment(*scene.after, width, height)) {}

MotionVectors::Moment MotionVectors::moment(const Scene& scene, std::int32_t width,
                                            std::int32_t height) const {
  Moment moment{scene, CameraRays(scene.camera, width, height), {}};
  std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> indices;
  std::int32_t index = 0;
  for (const auto& key : instance_keys(scene)) indices[key] = index++;
  for (const auto& key : instance_keys(scene_)) {
    const auto found = indices.find(key);
    moment.instances.push_back(found == indices.end() ? kNone : found->second);
  }
  return moment;
}

std::array<float, 4> MotionVectors::of(const Hit& hit) const {
  const auto at = [&](const Moment& moment) -> std::optional<FilmPoint> {
    const auto point = point_on(moment.scene, moment.instances[hit.id.instance], hit);
    return point ? moment.camera.project(*point) : std::nullopt;
  };
  const auto now = at(now_), before = at(before_), after = at(after_);
  std::array<float, 4> motion{};
  if (now && before) {
    motion[0] = limited(before->x - now->x);
    motion[1] = limited(now->y - before->y);
  }
  if (now && after) {
    motion[2] = limited(after->x - now->x);
    motion[3] = limited(now->y - after->y);
  }
  return motion;
}

}  // namespace tessera::render
