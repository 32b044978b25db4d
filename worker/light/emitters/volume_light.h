#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/light/emitters/shape_light.h"
#include "worker/light/tree/light_tree.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// Object-space boxes of a scene's meshes, at all keys, each computed when it is first needed.
class MeshBoxes {
 public:
  explicit MeshBoxes(const Scene& scene) : scene_(scene), boxes_(scene.meshes.size()) {}
  const Box3d& of(std::int32_t mesh);

 private:
  const Scene& scene_;
  std::vector<std::optional<Box3d>> boxes_;
};

/// The emissive medium inside a body as a light. Directions towards it are those of a ShapeLight
/// that encloses the body: the body's own shape if it has one, otherwise the box of its mesh, or
/// the box of the whole motion if it moves during the exposure.
class VolumeLight {
 public:
  /// The medium of `material` inside `instance`; nullopt if that has no volume. `scene`, `instance`
  /// and `material` must outlive it.
  static std::optional<VolumeLight> make(const Scene& scene, const InstanceView& instance,
                                         const MaterialView& material, MeshBoxes& boxes);

  /// Bounds for the light tree; the strength is the mean intensity over all directions.
  LightBounds bounds() const;

  const ShapeLight& hull() const { return *hull_; }
  const MediumView& medium() const { return material_->medium; }
  const MaterialView& material() const { return *material_; }
  const InstanceView& instance() const { return *instance_; }

 private:
  /// What a ShapeLight refers to.
  struct Placed {
    Shape shape;
    Affine3d object_to_world, world_to_object;
  };

  VolumeLight(const InstanceView& instance, const MaterialView& material, const Shape& shape,
              const Affine3d& object_to_world, const Affine3d& world_to_object);

  const InstanceView* instance_;
  const MaterialView* material_;
  std::unique_ptr<Placed> placed_;  // at a fixed address
  std::unique_ptr<ShapeLight> hull_;
};

}  // namespace tessera::render
