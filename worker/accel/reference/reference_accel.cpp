#include "worker/accel/reference/reference_accel.h"

#include <algorithm>
#include <limits>

#include "worker/accel/instance_boxes.h"
#include "worker/accel/mesh_triangles.h"
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
    : solids_(Solids::of(scene)) {
  std::vector<Box3f> meshes;
  for (const Mesh& mesh : scene.meshes) {
    parts_.push_back(make_part(mesh, structure));
    meshes.push_back(mesh.shape != nullptr ? mesh.shape->bounds : parts_.back().bounds);
  }
  const InstanceBoxes instances = place_instances(scene, meshes);
  origin_limit_ = instances.origin_limit;
  if (instances.boxes.empty()) return;
  std::vector<Vec3f> corners;
  for (std::size_t i = 0; i < instances.boxes.size(); ++i) {
    const Instance& instance = scene.instances[instances.instances[i]];
    placed_.push_back({instance.world_to_object, static_cast<std::uint32_t>(instance.mesh),
                       instances.instances[i],
                       solids_ == nullptr ? kNoSolid : solids_->at(instances.instances[i])});
    bounds_.extend(instances.boxes[i]);
    append_corners(instances.boxes[i], corners);
  }
  top_ = structure.build({instances.boxes, corners, 8});
}

ReferenceAccel::Part ReferenceAccel::make_part(const Mesh& mesh, const Structure& structure) {
  Part part;
  std::vector<Box3f> boxes;
  std::vector<Vec3f> corners;
  for_each_triangle(mesh, [&](std::uint32_t p, std::uint32_t t, const Vec3f& v0, const Vec3f& v1,
                              const Vec3f& v2) {
    part.triangles.push_back({v0, v1, v2, p, t});
    boxes.push_back({min(min(v0, v1), v2), max(max(v0, v1), v2)});
    corners.insert(corners.end(), {v0, v1, v2});
    part.bounds.extend(boxes.back());
  });
  if (!boxes.empty()) part.index = structure.build({boxes, corners, 3});
  return part;
}

template <typename Take>
bool ReferenceAccel::meet_mesh(const Placed& placed, const Ray& ray, const float& limit,
                               const Take& take, Work& work) const {
  const Part& part = parts_[placed.part];
  Vec3f origin = ray.origin, direction = ray.direction;
  if (!is_identity(placed.world_to_object)) {
    transform_ray(placed.world_to_object, ray.origin, ray.direction, origin, direction);
  }
  ShapeRay object_ray;
  if (!make_shape_ray(origin, direction, part.bounds, object_ray)) return false;
  const auto test = [&](std::uint32_t index) {
    const Triangle& triangle = part.triangles[index];
    const TriangleId id = {placed.instance, triangle.primitive, triangle.triangle};
    TriangleHit hit{};
    ++work.shapes;
    return !(id == ray.leaves) &&
           intersect_triangle(object_ray.slabs, triangle.v0, triangle.v1, triangle.v2, hit) &&
           hit.t >= 0 && hit.t < ray.t_max && take(Hit{hit.t, id, hit.b0, hit.b1, hit.b2});
  };
  return part.index->walk(object_ray, limit, ShapeVisitor(test), work);
}

template <typename Take>
bool ReferenceAccel::meet_solid(std::uint32_t solid, const Ray& ray, const Take& take,
                                Work& work) const {
  const auto collect = [&](const Operand& operand, const Ray& of, std::vector<Hit>& hits) {
    const float all = std::numeric_limits<float>::max();
    const auto add = [&](const Hit& hit) {
      hits.push_back(hit);
      return false;
    };
    meet_mesh({operand.world_to_object, operand.mesh, operand.instance, kNoSolid}, of, all, add,
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
bool ReferenceAccel::meet(const Ray& ray, const float& limit, const Take& take, Work& work) const {
  if (top_ == nullptr || !is_finite(ray.origin) || !is_finite(ray.direction)) return false;
  const auto test = [&](std::uint32_t index) {
    const Placed& placed = placed_[index];
    return placed.solid == kNoSolid ? meet_mesh(placed, ray, limit, take, work)
                                    : meet_solid(placed.solid, ray, take, work);
  };
  ShapeRay world_ray;
  if (max_abs(ray.origin) <= origin_limit_ &&
      make_shape_ray(ray.origin, ray.direction, bounds_, world_ray)) {
    return top_->walk(world_ray, limit, ShapeVisitor(test), work);
  }
  for (std::uint32_t i = 0; i < placed_.size(); ++i) {  // too far for the pads
    if (test(i)) return true;
  }
  return false;
}

bool ReferenceAccel::find_closest(const Ray& ray, const HitFilter* filter, Hit& hit,
                                  Work& work) const {
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
  Work work;
  return find_closest(ray, filter, hit, work);
}

bool ReferenceAccel::closest_hit(const Ray& ray, Hit& hit, Work& work) const {
  return find_closest(ray, nullptr, hit, work);
}

bool ReferenceAccel::any_hit(const Ray& ray, Work& work) const {
  const float limit = limit_of(ray);
  const auto take = [](const Hit&) { return true; };
  return meet(ray, limit, take, work);
}

bool ReferenceAccel::any_hit(const Ray& ray, const HitFilter* filter) const {
  if (filter == nullptr) {
    Work work;
    return any_hit(ray, work);
  }
  const std::vector<Hit> hits = all_hits(ray);  // each is shown once
  return std::any_of(hits.begin(), hits.end(), [&](const Hit& hit) { return (*filter)(hit); });
}

std::vector<Hit> ReferenceAccel::all_hits(const Ray& ray) const {
  Work work;
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
  std::size_t sum = placed_.capacity() * sizeof(Placed);
  if (top_ != nullptr) sum += top_->memory_bytes();
  for (const Part& part : parts_) {
    sum += part.triangles.capacity() * sizeof(Triangle);
    if (part.index != nullptr) sum += part.index->memory_bytes();
  }
  return sum;
}

}  // namespace tessera::render::reference
