#include "worker/accel/solids/solids.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/accel/solids/csg_line.h"
#include "worker/geometry/motion.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

/// Memory that the queries of a thread reuse.
struct Scratch {
  std::vector<ShapeHit> shape_hits;
  CsgLine line;
  std::vector<Hit> hits;
  Operand moved;
};

Scratch& scratch() {
  thread_local Scratch memory;
  return memory;
}

/// Returns the operand at a time, or null if its transform is singular. Copies a moving operand to
/// `memory`.
const Operand* operand_at(const Operand& operand, std::span<const float> key_times, float time,
                          Operand& memory) {
  if (operand.motion.empty()) return &operand;
  const auto pose = pose_at(operand.motion, find_key(key_times, time));
  if (!pose) return nullptr;
  memory.world_to_object = pose->world_to_object;
  memory.mesh = operand.mesh;
  memory.instance = operand.instance;
  memory.shape = operand.shape;
  memory.primitives = operand.primitives;
  return &memory;
}

void intersect_operand(const Operand& operand, const Ray& ray, const HitRequest& request,
                       std::vector<ShapeHit>& hits) {
  hits.clear();
  intersect_shape(*operand.shape, transform_point(operand.world_to_object, Vec3d(ray.origin)),
                  transform_vector(operand.world_to_object, Vec3d(ray.direction)), hits, request);
}

Hit to_hit(const Operand& operand, const ShapeHit& hit) {
  const Vec3f p(hit.point);
  return {static_cast<float>(hit.t), {operand.instance, 0, hit.face}, p.x, p.y, p.z};
}

/// Stores the hits of a single shape in `memory.hits`.
void intersect_single_shape(const Operand& operand, const Ray& ray, const HitRequest& request,
                            Scratch& memory) {
  intersect_operand(operand, ray, request, memory.shape_hits);
  std::vector<Hit>& out = memory.hits;
  for (const ShapeHit& found : memory.shape_hits) {
    const Hit hit = to_hit(operand, found);
    const bool origin_face = hit.id == ray.origin_triangle && found.face != kCurvedFace;
    if (!(found.t >= 0) || !std::isfinite(hit.t) || origin_face) continue;
    const bool duplicate = !out.empty() && out.back().t == hit.t && out.back().id == hit.id;
    if (!duplicate) out.push_back(hit);
  }
  std::sort(out.begin(), out.end(), precedes);
}

/// Adds the crossings of the ray with a shape to `memory.line`.
void add_shape(std::uint32_t number, const Operand& operand, const OperandLine& line,
               const Ray& ray, Scratch& memory) {
  memory.shape_hits.clear();
  intersect_shape(*operand.shape, line.origin, line.direction, memory.shape_hits);
  for (const ShapeHit& found : memory.shape_hits) {
    const Hit hit = to_hit(operand, found);
    const CrossingBounds bounds = shape_crossing(line, *operand.shape, found);
    const bool origin_face = hit.id == ray.origin_triangle && found.face != kCurvedFace;
    if (origin_face) memory.line.start_on_face(number, bounds);
    memory.line.add_shape(number, hit, bounds, found.enters, origin_face || found.t < 0);
  }
}

/// Adds the crossings in `memory.hits` of the ray with a mesh to `memory.line`.
void add_mesh(std::uint32_t number, const Operand& operand, const OperandLine& line, const Ray& ray,
              Scratch& memory) {
  if (ray.origin_triangle.instance == operand.instance) {
    const auto [v0, v1, v2] = triangle_of(operand, ray.origin_triangle);
    memory.line.start_on_face(number, triangle_crossing(line, Vec3d(v0), Vec3d(v1), Vec3d(v2)));
  }
  memory.line.add_mesh(number, operand, line, ray, memory.hits);
}

}  // namespace

Solids::Solids(const Scene& scene)
    : recentring_(scene.center),
      key_times_(scene.key_times),
      by_instance_(scene.instances.size(), kNoSolid) {
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    if (mesh.shape == nullptr || instance.operand) continue;
    by_instance_[i] = static_cast<std::uint32_t>(solids_.size());
    solids_.push_back(
        {static_cast<std::uint32_t>(operands_.size()),
         1,
         {},
         mesh.shape->form == Shape::Form::terrain || mesh.shape->form == Shape::Form::blobs});
    add(scene, i);
  }
  for (const CsgSolid& solid : scene.solids) {
    by_instance_[solid.first] = static_cast<std::uint32_t>(solids_.size());
    solids_.push_back({static_cast<std::uint32_t>(operands_.size()), solid.count, solid.steps});
    for (std::uint32_t i = 0; i < solid.count; ++i) add(scene, solid.first + i);
  }
}

void Solids::add(const Scene& scene, std::uint32_t index) {
  const Instance& instance = scene.instances[index];
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  operands_.push_back({instance.world_to_object, static_cast<std::uint32_t>(instance.mesh), index,
                       mesh.shape, mesh.primitives,
                       instance.motion == kNone
                           ? std::vector<Affine3d>()
                           : scene.motions[static_cast<std::size_t>(instance.motion)]});
}

std::shared_ptr<const Solids> Solids::of(const Scene& scene) {
  const bool any =
      !scene.solids.empty() || std::any_of(scene.meshes.begin(), scene.meshes.end(),
                                           [](const Mesh& mesh) { return mesh.shape != nullptr; });
  return any ? std::shared_ptr<const Solids>(new Solids(scene)) : nullptr;
}

std::span<const Hit> Solids::hits(std::uint32_t index, const Ray& world_ray,
                                  const MeshHits& mesh_hits, const HitLimits& limits) const {
  const Solid& solid = solids_[index];
  Scratch& memory = scratch();
  memory.hits.clear();
  if (solid.steps.empty()) {
    const Operand* const operand =
        operand_at(operands_[solid.first], key_times_, world_ray.time, memory.moved);
    // A double above t_max but below the next float may round to t_max.
    const HitRequest request = {0, double{next_up(limits.t_max)}, limits.first_only};
    if (operand != nullptr) intersect_single_shape(*operand, world_ray, request, memory);
    return memory.hits;
  }
  Ray ray = world_ray;
  ray.t_max = std::numeric_limits<float>::infinity();
  ray.origin_triangle.triangle &= ~kFlippedSide;
  memory.line.start(solid.count);
  for (std::uint32_t i = 0; i < solid.count; ++i) {
    const Operand* const posed =
        operand_at(operands_[solid.first + i], key_times_, ray.time, memory.moved);
    if (posed == nullptr) continue;
    const Operand& operand = *posed;
    const OperandLine line = {operand.world_to_object, ray, recentring_};
    if (operand.shape != nullptr) {
      add_shape(i, operand, line, ray, memory);
    } else {
      memory.hits.clear();
      mesh_hits(operand, ray, memory.hits);
      add_mesh(i, operand, line, ray, memory);
    }
  }
  memory.hits.clear();
  memory.line.finish(solid.steps, memory.hits);
  return memory.hits;
}

}  // namespace tessera::render
