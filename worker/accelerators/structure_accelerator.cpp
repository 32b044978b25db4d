#include "worker/accelerators/structure_accelerator.h"

#include <algorithm>
#include <iterator>
#include <limits>

#include "worker/accel/traversal/thread_counts.h"
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

StructureAccelerator::StructureAccelerator(const Scene& scene, const Structure& structure,
                                           std::span<const Ray> sample)
    : key_times_(scene.key_times), solids_(Solids::of(scene)) {
  const std::size_t count = key_times_.empty() ? 1 : key_times_.size() - 1;
  for (std::uint32_t s = 0; s < count; ++s) {
    std::vector<Ray> rays;
    std::copy_if(sample.begin(), sample.end(), std::back_inserter(rays),
                 [&](const Ray& ray) { return keyframe_position(ray).segment == s; });
    segments_.push_back(make_segment(scene, s, structure, rays));
  }
}

StructureAccelerator::TimeSegment StructureAccelerator::make_segment(
    const Scene& scene, std::uint32_t segment, const Structure& structure,
    std::span<const Ray> sample) const {
  TimeSegment out;
  std::vector<Box3f> meshes;
  for (const Mesh& mesh : scene.meshes) {
    Part part = make_part(mesh, segment);
    const Shape* const shape = mesh.shape.get();
    meshes.push_back(shape != nullptr ? shape->bounds : part.bounds);
    out.parts.push_back(std::move(part));
  }
  InstanceSelection all;
  if (!key_times_.empty()) all.segment = segment;
  const InstanceBoxes instances = bound_instances(scene, meshes, all);
  out.origin_limit = instances.origin_limit;
  place_instances(scene, instances, out);
  if (!out.placed.empty()) {
    std::vector<Vec3f> corners;
    for (const Box3f& box : instances.boxes) append_corners(box, corners);
    out.top = structure.build({instances.boxes, corners, 8, sample});
  }
  const std::vector<std::vector<Ray>> rays = rays_by_part(out, sample);
  for (std::size_t i = 0; i < out.parts.size(); ++i) {
    Part& part = out.parts[i];
    part.index = build_index(part, !scene.meshes[i].keys.empty(), rays[i], structure);
  }
  return out;
}

void StructureAccelerator::place_instances(const Scene& scene, const InstanceBoxes& instances,
                                           TimeSegment& out) const {
  for (const std::uint32_t index : instances.unbounded) {
    out.unbounded.push_back(solids_->at(index));
  }
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
  }
}

StructureAccelerator::Part StructureAccelerator::make_part(const Mesh& mesh,
                                                           std::uint32_t segment) {
  Part part;
  for_each_triangle(mesh, segment,
                    [&](std::uint32_t p, std::uint32_t t, const MovingTriangle& triangle) {
                      part.triangles.push_back({triangle, p, t});
                      part.bounds.extend(triangle.box());
                    });
  return part;
}

/// Returns null for a part without triangles.
std::unique_ptr<ShapeIndex> StructureAccelerator::build_index(const Part& part, bool moves,
                                                              std::span<const Ray> sample,
                                                              const Structure& structure) {
  if (part.triangles.empty()) return nullptr;
  std::vector<Box3f> boxes;
  std::vector<Vec3f> corners;
  for (const Triangle& triangle : part.triangles) {
    const MovingTriangle& at = triangle.corners;
    boxes.push_back(at.box());
    corners.insert(corners.end(), at.from.begin(), at.from.end());
    if (moves) corners.insert(corners.end(), at.to.begin(), at.to.end());
  }
  return structure.build({boxes, corners, moves ? 6u : 3u, sample});
}

/// Returns for each part the rays that may meet its instances, in its space.
std::vector<std::vector<Ray>> StructureAccelerator::rays_by_part(
    const TimeSegment& segment, std::span<const Ray> sample) const {
  std::vector<std::vector<Ray>> rays(segment.parts.size());
  for (const Ray& ray : sample) {
    const auto add = [&](std::uint32_t index) {
      const Placed& placed = segment.placed[index];
      if (const auto seen = in_object_space(placed, ray)) rays[placed.part].push_back(*seen);
      return false;
    };
    ShapeRay world_ray;
    TraversalStats stats;
    if (segment.top != nullptr &&
        make_shape_ray(ray.origin, ray.direction, segment.bounds, world_ray)) {
      segment.top->traverse(world_ray, ray.t_max, ShapeVisitor(add), stats);
    }
  }
  return rays;
}

/// Returns the ray in the space of an instance, or nothing if it is singular at the ray's time.
std::optional<Ray> StructureAccelerator::in_object_space(const Placed& placed,
                                                         const Ray& ray) const {
  Affine3d world_to_object = placed.world_to_object;
  if (!placed.motion.empty()) {
    const auto pose = pose_at(placed.motion, keyframe_position(ray));
    if (!pose) return std::nullopt;
    world_to_object = pose->world_to_object;
  }
  Ray out = ray;
  if (!is_identity(world_to_object)) {
    transform_ray(world_to_object, ray.origin, ray.direction, out.origin, out.direction);
  }
  return out;
}

KeyframePosition StructureAccelerator::keyframe_position(const Ray& ray) const {
  return key_times_.empty() ? KeyframePosition{} : find_key(key_times_, ray.time);
}

template <typename Offer>
bool StructureAccelerator::intersect_mesh(const Placed& placed, const Ray& ray, const float& limit,
                                          const Offer& offer, TraversalStats& stats) const {
  const KeyframePosition at = keyframe_position(ray);
  const Part& part = segments_[at.segment].parts[placed.part];
  const std::optional<Ray> local = in_object_space(placed, ray);
  ShapeRay object_ray;
  if (!local || !make_shape_ray(local->origin, local->direction, part.bounds, object_ray)) {
    return false;
  }
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
