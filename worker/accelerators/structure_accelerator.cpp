#include "worker/accelerators/structure_accelerator.h"

#include <algorithm>
#include <limits>

#include "worker/accel/build/instance_boxes.h"
#include "worker/accel/build/mesh_triangles.h"
#include "worker/accel/kernels/thread_counts.h"
#include "worker/geometry/triangle.h"

namespace tessera::render::accelerators {
namespace {

float limit_of(const Ray& ray) {
  return std::min(ray.t_max, std::numeric_limits<float>::max());
}

void append_corners(const Box3f& box, std::vector<Vec3f>& corners) {
  for (int i = 0; i < 8; ++i) {
    corners.push_back({(i & 1) != 0 ? box.hi.x : box.lo.x, (i & 2) != 0 ? box.hi.y : box.lo.y,
                       (i & 4) != 0 ? box.hi.z : box.lo.z});
  }
}

/// The cost of a query, added to thread_traversal_counts() at its end.
struct CountedQuery {
  TraversalStats stats;

  CountedQuery() = default;
  CountedQuery(const CountedQuery&) = delete;
  CountedQuery& operator=(const CountedQuery&) = delete;
  ~CountedQuery() { thread_traversal_counts() += {1, stats.nodes, stats.shapes}; }
};

}  // namespace

StructureAccelerator::StructureAccelerator(const Scene& scene, const Structure& structure)
    : key_times_(scene.key_times), solids_(Solids::of(scene)) {
  const std::size_t count = key_times_.empty() ? 1 : key_times_.size() - 1;
  for (std::uint32_t s = 0; s < count; ++s) {
    segments_.push_back(make_segment(scene, s, structure));
  }
}

StructureAccelerator::TimeSegment StructureAccelerator::make_segment(
    const Scene& scene, std::uint32_t segment, const Structure& structure) const {
  TimeSegment out;
  std::vector<Box3f> meshes;
  for (const Mesh& mesh : scene.meshes) {
    Part part = make_part(mesh, segment, structure);
    const Shape* const shape = mesh.shape.get();
    meshes.push_back(shape != nullptr ? shape->bounds : part.bounds);
    out.parts.push_back(std::move(part));
  }
  InstanceSelection all;
  if (!key_times_.empty()) all.segment = segment;
  const InstanceBoxes instances = bound_instances(scene, meshes, all);
  out.origin_limit = instances.origin_limit;
  for (const std::uint32_t index : instances.unbounded) {
    out.unbounded.push_back(solids_->at(index));
  }
  if (instances.boxes.empty()) return out;
  std::vector<Vec3f> corners;
  for (std::size_t i = 0; i < instances.boxes.size(); ++i) {
    const Instance& instance = scene.instances[instances.instances[i]];
    Placed& placed = out.placed.emplace_back();
    placed.world_to_object = instance.world_to_object;
    placed.part = static_cast<std::uint32_t>(instance.mesh);
    placed.instance = instances.instances[i];
    placed.solid = solids_ == nullptr ? kNoSolid : solids_->at(placed.instance);
    if (instance.motion != kNone) {
      placed.motion = scene.motions[static_cast<std::size_t>(instance.motion)];
    }
    out.bounds.extend(instances.boxes[i]);
    append_corners(instances.boxes[i], corners);
  }
  out.top = structure.build({instances.boxes, corners, 8});
  return out;
}

StructureAccelerator::Part StructureAccelerator::make_part(const Mesh& mesh, std::uint32_t segment,
                                                           const Structure& structure) {
  Part part;
  std::vector<Box3f> boxes;
  std::vector<Vec3f> corners;
  const bool moves = !mesh.keys.empty();
  for_each_triangle(mesh, segment,
                    [&](std::uint32_t p, std::uint32_t t, const MovingTriangle& triangle) {
                      part.triangles.push_back({triangle, p, t});
                      boxes.push_back(triangle.box());
                      corners.insert(corners.end(), triangle.from.begin(), triangle.from.end());
                      if (moves) {
                        corners.insert(corners.end(), triangle.to.begin(), triangle.to.end());
                      }
                      part.bounds.extend(boxes.back());
                    });
  if (!boxes.empty()) part.index = structure.build({boxes, corners, moves ? 6u : 3u});
  return part;
}

KeyframePosition StructureAccelerator::keyframe_position(const Ray& ray) const {
  return key_times_.empty() ? KeyframePosition{} : find_key(key_times_, ray.time);
}

template <typename Offer>
bool StructureAccelerator::intersect_mesh(const Placed& placed, const Ray& ray, const float& limit,
                                          const Offer& offer, TraversalStats& stats) const {
  const KeyframePosition at = keyframe_position(ray);
  const Part& part = segments_[at.segment].parts[placed.part];
  Affine3d world_to_object = placed.world_to_object;
  if (!placed.motion.empty()) {
    const auto pose = pose_at(placed.motion, at);
    if (!pose) return false;
    world_to_object = pose->world_to_object;
  }
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!is_identity(world_to_object)) {
    transform_ray(world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ShapeRay object_ray;
  if (!make_shape_ray(origin, direction, part.bounds, object_ray)) return false;
  const auto test = [&](std::uint32_t index) {
    const Triangle& triangle = part.triangles[index];
    const TriangleId id = {placed.instance, triangle.primitive, triangle.triangle};
    const auto [v0, v1, v2] = triangle.corners.at(at.f);
    TriangleHit hit{};
    ++stats.shapes;
    return !(id == ray.origin_triangle) && intersect_triangle(object_ray.slabs, v0, v1, v2, hit) &&
           hit.t >= 0 && hit.t < ray.t_max && offer(Hit{hit.t, id, hit.b0, hit.b1, hit.b2});
  };
  return part.index->traverse(object_ray, limit, ShapeVisitor(test), stats);
}

template <typename Offer>
bool StructureAccelerator::intersect_solid(std::uint32_t solid, const Ray& ray, const Offer& offer,
                                           TraversalStats& stats) const {
  const auto collect = [&](const Operand& operand, const Ray& of, std::vector<Hit>& hits) {
    const float all = std::numeric_limits<float>::max();
    const auto add = [&](const Hit& hit) {
      hits.push_back(hit);
      return false;
    };
    intersect_mesh({operand.world_to_object, operand.mesh, operand.instance, kNoSolid, {}}, of, all,
                   add, stats);
  };
  ++stats.shapes;
  for (const Hit& hit : solids_->hits(solid, ray, MeshHits(collect))) {
    if (hit.t < ray.t_max && offer(hit)) return true;
  }
  return false;
}

/// Calls offer(hit) for each hit, in any order and some more than once, until it returns true.
/// Returns whether it did.
template <typename Offer>
bool StructureAccelerator::intersect(const Ray& ray, const float& limit, const Offer& offer,
                                     TraversalStats& stats) const {
  const TimeSegment& segment = segments_[keyframe_position(ray).segment];
  if (!is_finite(ray.origin) || !is_finite(ray.direction)) return false;
  for (const std::uint32_t solid : segment.unbounded) {
    if (intersect_solid(solid, ray, offer, stats)) return true;
  }
  if (segment.top == nullptr) return false;
  const auto test = [&](std::uint32_t index) {
    const Placed& placed = segment.placed[index];
    return placed.solid == kNoSolid ? intersect_mesh(placed, ray, limit, offer, stats)
                                    : intersect_solid(placed.solid, ray, offer, stats);
  };
  ShapeRay world_ray;
  if (max_abs(ray.origin) <= segment.origin_limit &&
      make_shape_ray(ray.origin, ray.direction, segment.bounds, world_ray)) {
    return segment.top->traverse(world_ray, limit, ShapeVisitor(test), stats);
  }
  for (std::uint32_t i = 0; i < segment.placed.size(); ++i) {  // the padding is too small
    if (test(i)) return true;
  }
  return false;
}

bool StructureAccelerator::find_closest(const Ray& ray, const HitFilter* filter, Hit& hit,
                                        TraversalStats& stats) const {
  float limit = limit_of(ray);
  bool found = false;
  const auto offer = [&](const Hit& candidate) {
    if (found && !precedes(candidate, hit)) return false;
    if (filter != nullptr && !(*filter)(candidate)) return false;
    hit = candidate;
    limit = candidate.t;
    found = true;
    return false;  // a nearer hit may follow
  };
  intersect(ray, limit, offer, stats);
  return found;
}

bool StructureAccelerator::closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  CountedQuery query;
  return find_closest(ray, filter, hit, query.stats);
}

bool StructureAccelerator::closest_hit(const Ray& ray, Hit& hit, TraversalStats& stats) const {
  return find_closest(ray, nullptr, hit, stats);
}

bool StructureAccelerator::any_hit(const Ray& ray, TraversalStats& stats) const {
  const float limit = limit_of(ray);
  const auto offer = [](const Hit&) { return true; };
  return intersect(ray, limit, offer, stats);
}

bool StructureAccelerator::any_hit(const Ray& ray, const HitFilter* filter) const {
  CountedQuery query;
  if (filter == nullptr) return any_hit(ray, query.stats);
  const std::vector<Hit> hits = find_all(ray, query.stats);  // offers each hit once
  return std::any_of(hits.begin(), hits.end(), [&](const Hit& hit) { return (*filter)(hit); });
}

std::vector<Hit> StructureAccelerator::all_hits(const Ray& ray) const {
  TraversalStats stats;
  return find_all(ray, stats);
}

std::vector<Hit> StructureAccelerator::find_all(const Ray& ray, TraversalStats& stats) const {
  std::vector<Hit> hits;
  const float limit = limit_of(ray);
  const auto offer = [&](const Hit& hit) {
    hits.push_back(hit);
    return false;
  };
  intersect(ray, limit, offer, stats);
  std::sort(hits.begin(), hits.end(), precedes);
  const auto same = [](const Hit& a, const Hit& b) { return a.t == b.t && a.id == b.id; };
  hits.erase(std::unique(hits.begin(), hits.end(), same), hits.end());
  return hits;
}

std::size_t StructureAccelerator::memory_bytes() const {
  std::size_t sum = 0;
  for (const TimeSegment& segment : segments_) {
    sum += segment.placed.capacity() * sizeof(Placed);
    if (segment.top != nullptr) sum += segment.top->memory_bytes();
    for (const Part& part : segment.parts) {
      sum += part.triangles.capacity() * sizeof(Triangle);
      if (part.index != nullptr) sum += part.index->memory_bytes();
    }
  }
  return sum;
}

}  // namespace tessera::render::accelerators
