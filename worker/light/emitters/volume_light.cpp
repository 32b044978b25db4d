#include "worker/light/emitters/volume_light.h"

#include <cmath>
#include <vector>

#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/make_shape.h"

namespace tessera::render {
namespace {

/// Object-space box of a mesh, at all keys if it deforms.
Box3d box_of(const Mesh& mesh) {
  Box3d box;
  if (mesh.shape != nullptr) {
    box.extend(Vec3d(mesh.shape->bounds.lo));
    box.extend(Vec3d(mesh.shape->bounds.hi));
    return box;
  }
  const auto extend = [&box](const SharedArray<Primitive>& primitives) {
    for (const Primitive& p : primitives) {
      for (const Vec3f& v : p.positions) box.extend(Vec3d(v));
    }
  };
  extend(mesh.primitives);
  for (const SharedArray<Primitive>& key : mesh.keys) extend(key);
  return box;
}

void extend_by(Box3d& out, const Affine3d& m, const Box3d& box) {
  for (int corner = 0; corner < 8; ++corner) {
    out.extend(transform_point(
        m, Vec3d{(corner & 1) != 0 ? box.hi.x : box.lo.x, (corner & 2) != 0 ? box.hi.y : box.lo.y,
                 (corner & 4) != 0 ? box.hi.z : box.lo.z}));
  }
}

/// A box of the world that contains `box` of an instance at all times of the exposure: matrices are
/// linear between keys, so points stay in the convex hull of their places at the keys.
Box3d box_of_motion(const Scene& scene, const Instance& instance, const Box3d& box) {
  Box3d out;
  if (instance.motion == kNone) {
    extend_by(out, instance.object_to_world, box);
    return out;
  }
  for (const Affine3d& key : scene.motions[static_cast<std::size_t>(instance.motion)]) {
    extend_by(out, key, box);
  }
  return out;
}

/// Volume of a closed shape in its object space, by lines along y through a lattice of points. An
/// error makes the choice among lights less good, but no result wrong.
double volume_of(const Shape& shape) {
  constexpr int kLines = 24;  // along x and along z
  const Vec3d low(shape.bounds.lo), step = (Vec3d(shape.bounds.hi) - low) / double{kLines};
  std::vector<ShapeHit> hits;
  double inside = 0;
  for (int i = 0; i < kLines * kLines; ++i) {
    const int row = i / kLines, column = i % kLines;
    hits.clear();
    intersect_shape(shape, {low.x + (column + 0.5) * step.x, low.y, low.z + (row + 0.5) * step.z},
                    {0, 1, 0}, hits);
    for (std::size_t k = 0; k + 1 < hits.size(); k += 2) inside += hits[k + 1].t - hits[k].t;
  }
  return inside * step.x * step.z;
}

Affine3d moved_by(const Affine3d& m, const Vec3d& offset) {
  return m * Affine3d{{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, offset};
}

}  // namespace

const Box3d& MeshBoxes::of(std::int32_t mesh) {
  const auto index = static_cast<std::size_t>(mesh);
  if (!boxes_[index]) boxes_[index] = box_of(scene_.meshes[index]);
  return *boxes_[index];
}

VolumeLight::VolumeLight(const InstanceView& instance, const MaterialView& material,
                         const Shape& shape, const Affine3d& object_to_world,
                         const Affine3d& world_to_object)
    : instance_(&instance),
      material_(&material),
      placed_(std::make_unique<Placed>(Placed{shape, object_to_world, world_to_object})),
      hull_(std::make_unique<ShapeLight>(placed_->object_to_world, placed_->world_to_object,
                                         placed_->shape)) {}

std::optional<VolumeLight> VolumeLight::make(const Scene& scene, const InstanceView& instance,
                                             const MaterialView& material, MeshBoxes& boxes) {
  const Instance& source = *instance.source;
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(source.mesh)];
  const bool moves = source.motion != kNone || !mesh.keys.empty();
  if (!moves && mesh.shape != nullptr && mesh.shape->closed()) {
    return VolumeLight(instance, material, *mesh.shape, source.object_to_world,
                       source.world_to_object);
  }
  Box3d box = boxes.of(source.mesh);
  Affine3d place = source.object_to_world;
  if (moves) {
    box = box_of_motion(scene, source, box);
    place = {};
  }
  const Vec3d size = box.hi - box.lo;
  if (!(size.x > 0 && size.y > 0 && size.z > 0)) return std::nullopt;
  place = moved_by(place, (box.lo + box.hi) * 0.5);
  const auto inverted = inverse(place);
  if (!inverted) return std::nullopt;
  return VolumeLight(instance, material, make_box(size), place, *inverted);
}

/// The mean chord of a convex body is its volume over its mean projected area.
LightBounds VolumeLight::bounds() const {
  LightBounds light = hull_->bounds(1, false);  // its strength is that area
  const double volume =
      volume_of(placed_->shape) * std::fabs(determinant(placed_->object_to_world));
  MediumView typical = medium();
  typical.emission *= typical.typical_density;
  typical.extinction *= typical.typical_density;
  const auto chord = static_cast<float>(volume / light.strength);
  light.strength *= static_cast<double>(luminance(emission_over(typical, chord)));
  return light;
}

}  // namespace tessera::render
