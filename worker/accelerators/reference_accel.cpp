#include "worker/accelerators/reference_accel.h"

#include <algorithm>
#include <limits>

#include "worker/accel/build/instance_boxes.h"
#include "worker/accel/build/mesh_triangles.h"
#include "worker/geometry/triangle.h"

namespace tessera::render::reference {
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

}  // namespace

ReferenceAccel::ReferenceAccel(const Scene& scene, const Structure& structure)
    : key_times_(scene.key_times), solids_(Solids::of(scene)) {
  const std::size_t count = key_times_.empty() ? 1 : key_times_.size() - 1;
  for (std::uint32_t s = 0; s < count; ++s) {
    stretches_.push_back(make_stretch(scene, s, structure));
  }
}

ReferenceAccel::TimeSegment ReferenceAccel::make_stretch(const Scene& scene, std::uint32_t segment,
                                                     const Structure& structure) const {
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

ReferenceAccel::Part ReferenceAccel::make_part(const Mesh& mesh, std::uint32_t segment,
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

KeyframePosition ReferenceAccel::place_of(const Ray& ray) const {
  return key_times_.empty() ? KeyframePosition{} : find_key(key_times_, ray.time);
}

template <typename Take>
bool ReferenceAccel::meet_mesh(const Placed& placed, const Ray& ray, const float& limit,
                               const Take& take, TraversalStats& work) const {
  const KeyframePosition at = place_of(ray);
  const Part& part = stretches_[at.segment].parts[placed.part];
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
    ++work.shapes;
    return !(id == ray.origin_triangle) && intersect_triangle(object_ray.slabs, v0, v1, v2, hit) &&
           hit.t >= 0 && hit.t < ray.t_max && take(Hit{hit.t, id, hit.b0, hit.b1, hit.b2});
  };
  return part.index->walk(object_ray, limit, ShapeVisitor(test), work);
}

template <typename Take>
bool ReferenceAccel::meet_solid(std::uint32_t solid, const Ray& ray, const Take& take,
                                TraversalStats& work) const {
  const auto collect = [&](const Operand& operand, const Ray& of, std::vector<Hit>& hits) {
    const float all = std::numeric_limits<float>::max();
    const auto add = [&](const Hit& hit) {
      hits.push_back(hit);
      return false;
    };
    meet_mesh({operand.world_to_object, operand.mesh, operand.instance, kNoSolid, {}}, of, all, add,
              work);
  };
  ++work.shapes;
  for (const Hit& hit : solids_->hits(solid, ray, MeshHits(collect))) {
    if (hit.t < ray.t_max && take(hit)) return true;
  }
  return false;
}

/// Shows `take` hits in any order, some more than once, until it returns true.
template <typename Take>
bool ReferenceAccel::meet(const Ray& ray, const float& limit, const Take& take, TraversalStats& work) const {
  const TimeSegment& stretch = stretches_[place_of(ray).segment];
  if (stretch.top == nullptr || !is_finite(ray.origin) || !is_finite(ray.direction)) return false;
  const auto test = [&](std::uint32_t index) {
    const Placed& placed = stretch.placed[index];
    return placed.solid == kNoSolid ? meet_mesh(placed, ray, limit, take, work)
                                    : meet_solid(placed.solid, ray, take, work);
  };
  ShapeRay world_ray;
  if (max_abs(ray.origin) <= stretch.origin_limit &&
      make_shape_ray(ray.origin, ray.direction, stretch.bounds, world_ray)) {
    return stretch.top->walk(world_ray, limit, ShapeVisitor(test), work);
  }
  for (std::uint32_t i = 0; i < stretch.placed.size(); ++i) {  // too far for the pads
    if (test(i)) return true;
  }
  return false;
}

bool ReferenceAccel::find_closest(const Ray& ray, const HitFilter* filter, Hit& hit,
                                  TraversalStats& work) const {
  float limit = limit_of(ray);
  bool found = false;
  const auto take = [&](const Hit& candidate) {
    if (found && !precedes(candidate, hit)) return false;
    if (filter != nullptr && !(*filter)(candidate)) return false;
    hit = candidate;
    limit = candidate.t;
    found = true;
    return false;  // a nearer one may come
  };
  meet(ray, limit, take, work);
  return found;
}

bool ReferenceAccel::closest_hit(const Ray& ray, const HitFilter* filter, Hit& hit) const {
  TraversalStats work;
  return find_closest(ray, filter, hit, work);
}

bool ReferenceAccel::closest_hit(const Ray& ray, Hit& hit, TraversalStats& work) const {
  return find_closest(ray, nullptr, hit, work);
}

bool ReferenceAccel::any_hit(const Ray& ray, TraversalStats& work) const {
  const float limit = limit_of(ray);
  const auto take = [](const Hit&) { return true; };
  return meet(ray, limit, take, work);
}

bool ReferenceAccel::any_hit(const Ray& ray, const HitFilter* filter) const {
  if (filter == nullptr) {
    TraversalStats work;
    return any_hit(ray, work);
  }
  const std::vector<Hit> hits = all_hits(ray);  // each is shown once
  return std::any_of(hits.begin(), hits.end(), [&](const Hit& hit) { return (*filter)(hit); });
}

std::vector<Hit> ReferenceAccel::all_hits(const Ray& ray) const {
  TraversalStats work;
  std::vector<Hit> hits;
  const float limit = limit_of(ray);
  const auto take = [&](const Hit& hit) {
    hits.push_back(hit);
    return false;
  };
  meet(ray, limit, take, work);
  std::sort(hits.begin(), hits.end(), precedes);
  const auto same = [](const Hit& a, const Hit& b) { return a.t == b.t && a.id == b.id; };
  hits.erase(std::unique(hits.begin(), hits.end(), same), hits.end());
  return hits;
}

std::size_t ReferenceAccel::memory_bytes() const {
  std::size_t sum = 0;
  for (const TimeSegment& stretch : stretches_) {
    sum += stretch.placed.capacity() * sizeof(Placed);
    if (stretch.top != nullptr) sum += stretch.top->memory_bytes();
    for (const Part& part : stretch.parts) {
      sum += part.triangles.capacity() * sizeof(Triangle);
      if (part.index != nullptr) sum += part.index->memory_bytes();
    }
  }
  return sum;
}

}  // namespace tessera::render::reference
